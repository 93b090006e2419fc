"""Training on surface layers: the library's inputs to its network are kept unchanged, and crops of
them are learnt from."""

from pathlib import Path

import numpy as np
import pytest
import torch

from liveview_ref.checkpoint import load_network, load_state
from liveview_ref.config import read_config
from liveview_ref.data.procedural.textures import Textures
from liveview_ref.data.scene import open_scene, write_scene
from liveview_ref.data.surface_frames import SurfaceFrame, frame_of, held_out_rig, procedural_rig
from liveview_ref.export import check, export
from liveview_ref.reference.view_agreement import AgreementUNet, agreement_logits
from liveview_ref.training.fine_tune import start_of
from liveview_ref.training.train_surface import (
    CELL,
    crop_of,
    example_loss,
    interest,
    recoloured,
    rendered,
    without_a_view,
)  # fmt: skip
from liveview_ref.weights import fold_batchnorm, unfold_batchnorm

ROOT = Path(__file__).parents[3]
CONFIG = read_config(ROOT / "python/configs/v4_surface.json")


def made_up() -> SurfaceFrame:
    g = torch.Generator().manual_seed(5)

    def random(*shape):
        return torch.randint(1, 256, shape, generator=g, dtype=torch.uint8)

    coverage = torch.full((3, 4, 160, 144), 255, dtype=torch.uint8)
    return SurfaceFrame(random(3, 4, 3, 160, 144), coverage, random(3, 160, 144), torch.tensor([1.0, 2.0, 2.5, 4.0]))


def test_written_scene_is_read_back(tmp_path):
    rng = np.random.default_rng(2)
    rig = procedural_rig(rng, CONFIG | {"frame": [48, 64], "photos": [5, 6]}, Textures(None))
    write_scene(tmp_path, rig.photos, rig.cameras)
    scene = open_scene(tmp_path)
    assert len(scene.names) == len(rig.photos) == 6
    for i, (photo, camera) in enumerate(zip(rig.photos, rig.cameras, strict=True)):
        torch.testing.assert_close(scene.image_u8(i).float() / 255, photo, atol=0.5 / 255 + 1e-6, rtol=0)
        for part in ("k", "rotation", "translation"):
            torch.testing.assert_close(getattr(scene.cameras[i], part), getattr(camera, part), atol=1e-9, rtol=1e-9)


def test_crops_are_drawn_where_the_agreement_of_the_views_is_wrong():
    frame = made_up()
    frame.colour[:] = frame.target
    frame.colour[:, :, :, 110:150, 100:140] = 255 - frame.target[:, 110:150, 100:140]
    chances = interest(frame, CONFIG["crop"])
    assert chances.shape == ((160 - 128) // CELL + 1, (144 - 128) // CELL + 1) and np.isclose(chances.sum(), 1)
    assert np.unravel_index(chances.argmax(), chances.shape) == (2, 1) and chances.min() > 0.01


@pytest.mark.parametrize("seed", range(4))
def test_flipped_crop_keeps_its_parts_aligned(seed):
    frame = made_up()
    frame.coverage[:] = frame.target[0]  # the same picture in all of them
    frame.colour[:] = frame.target
    crop = crop_of(frame, interest(frame, CONFIG["crop"]), np.random.default_rng(seed), CONFIG)
    assert crop.colour.shape == (3, 4, 3, 128, 128)
    assert torch.equal(crop.colour, crop.target.expand_as(crop.colour))
    assert torch.equal(crop.coverage, crop.target[0].expand_as(crop.coverage))


def test_colour_changes_are_the_same_in_all_views():
    frame = made_up()
    frame.colour[:] = frame.target
    frame.colour[0, 1, :, :9] = 0  # masked
    found = recoloured(frame, np.random.default_rng(0))
    assert (found.target != frame.target).float().mean() > 0.5
    assert torch.equal(found.colour[1:], found.target.expand_as(found.colour[1:]))
    assert not found.colour[0, 1, :, :9].any()


def test_a_single_view_is_masked():
    frame = made_up()
    for seed in range(8):
        found = without_a_view(frame, np.random.default_rng(seed))
        masked = [v for v in range(4) if not found.coverage[:, v].any()]
        assert len(masked) == 1 and not found.colour[:, masked[0]].any()
        assert found.colour.any(dim=0).flatten(1).any(1).sum() == 3


def test_network_without_weights_is_the_agreement_of_the_views():
    net = start_of(load_state(ROOT / "models/liveview_v4.pt"), CONFIG)
    frame = made_up()
    colour = frame.colour.float() / 255
    with torch.no_grad():
        torch.testing.assert_close(net(colour.flatten(1, 2)), agreement_logits(colour, frame.coverage))
    loss, figures = example_loss(net, made_up())
    assert float(loss.detach()) == pytest.approx(0, abs=1e-6) and figures["gain"] == pytest.approx(0, abs=1e-5)
    assert isinstance(fold_batchnorm(unfold_batchnorm(net)), AgreementUNet)


def test_loss_falls_towards_the_view_that_is_right():
    frame = made_up()
    frame.target[:] = frame.colour[0, 3]
    frame.colour[:, 3] = frame.target
    crop = crop_of(frame, interest(frame, CONFIG["crop"]), np.random.default_rng(1), CONFIG)
    net = start_of(load_state(ROOT / "models/liveview_v4.pt"), CONFIG)
    optimiser = torch.optim.Adam(net.parameters(), 3e-3)
    for _ in range(12):
        loss, figures = example_loss(net, crop)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    assert figures["gain"] > 0.5 and float(loss.detach()) < -0.1


def test_exported_network_adds_the_agreement(tmp_path):
    torch.manual_seed(0)
    net = AgreementUNet(4).eval()
    path = tmp_path / "model.onnx"
    export(net, path, {"added_to": "view agreement"})
    assert check(net, path) < 3e-6 and isinstance(load_network(path), AgreementUNet)


def test_frame_renders_like_the_library(tmp_path):
    pytest.importorskip("liveview_ref.extension", exc_type=ImportError)
    spec = {"path": "workshop", "width": None, "targets": [7, 8]}
    rig = held_out_rig(open_scene(ROOT / "tests/scenes/workshop"), spec, 7, 4)
    frame, found = frame_of(rig, CONFIG | {"views": 4, "layers": 2})
    frame.save(tmp_path / "frame.pt")
    frame = SurfaceFrame.load(tmp_path / "frame.pt")
    colour, coverage = frame.colour / 255, frame.coverage / 255
    torch.testing.assert_close(colour.flatten(1, 2), torch.from_numpy(found["colour"]), atol=0.002, rtol=0)
    torch.testing.assert_close(coverage, torch.from_numpy(found["coverage"]), atol=0.002, rtol=0)
    difference = rendered(agreement_logits(colour, coverage), colour, coverage, frame.distances)
    difference = (difference - torch.from_numpy(found["frame"])).abs()
    # A byte is a step of 0.004, which a small coverage divides; uncovered pixels are inpainted by
    # the library.
    height, width = difference.shape[-2:]
    seen = coverage.amin(0).amax(0)[:height, :width] > 0.5
    assert seen.float().mean() > 0.9
    assert difference.mean() < 1e-3 and difference[:, seen].max() < 0.1
    assert 0.01 < float((frame.coverage == 0).float().mean()) < 0.2
