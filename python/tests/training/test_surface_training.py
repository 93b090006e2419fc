"""Training on surface layers: the program's inputs to its network are kept unchanged, and crops of
them are learnt from."""

import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from liveview_ref.checkpoint import load_network, load_state, trained_network
from liveview_ref.config import read_config
from liveview_ref.data.procedural.textures import Textures
from liveview_ref.data.scene import open_scene
from liveview_ref.data.surface_frames import SurfaceFrame, dumped, frame_of, held_out_rig, procedural_rig, write_scene
from liveview_ref.data.visibility import HIDDEN, SEEN
from liveview_ref.reference.render.blend import VISIBLE_POWER
from liveview_ref.reference.unet import UNet, fold_batchnorm, unfold_batchnorm
from liveview_ref.training import fit_view_weights, mix
from liveview_ref.training.surface_loss import CELL, crop_of, example_loss, interest, masks, recoloured, rendered

ROOT = Path(__file__).parents[3]
CONFIG = read_config(ROOT / "python/configs/v4_surface.json")
PROGRAM = ROOT / "target/release/liveview"


def made_up(seen: bool) -> SurfaceFrame:
    g = torch.Generator().manual_seed(5)

    def random(*shape, top=256):
        return torch.randint(0, top, shape, generator=g, dtype=torch.uint8)

    shown = (torch.rand(2 + seen, 4, 160, 144, generator=g) < 0.8).to(torch.uint8)
    coverage = torch.full_like(shown, 255)
    known = random(4, 160, 144, top=2) if seen else None
    return SurfaceFrame(random(2 + seen, 4, 3, 160, 144), coverage, shown, random(3, 160, 144),
                        torch.tensor([1.0, 2.0, 2.5, 4.0]), known)  # fmt: skip


def test_written_scene_is_read_back(tmp_path):
    rng = np.random.default_rng(2)
    rig = procedural_rig(rng, CONFIG | {"frame": [48, 64], "photos": [5, 6]}, Textures(None))
    write_scene(rig, tmp_path)
    scene = open_scene(tmp_path)
    assert len(scene.names) == len(rig.photos) == 6
    for i, (photo, camera) in enumerate(zip(rig.photos, rig.cameras, strict=True)):
        torch.testing.assert_close(scene.image_u8(i).float() / 255, photo, atol=0.5 / 255 + 1e-6, rtol=0)
        for part in ("k", "rotation", "translation"):
            torch.testing.assert_close(getattr(scene.cameras[i], part), getattr(camera, part), atol=1e-9, rtol=1e-9)


def test_crops_are_drawn_where_views_are_occluded():
    frame = made_up(seen=False)
    frame.shown[:], frame.colour[:] = 1, frame.target
    frame.shown[0, 1, 100:150, 90:140] = 0
    chances = interest(frame, CONFIG["crop"])
    assert chances.shape == ((160 - 112) // CELL + 1, (144 - 112) // CELL + 1) and np.isclose(chances.sum(), 1)
    assert np.unravel_index(chances.argmax(), chances.shape) == (3, 2) and chances.min() > 0.01


@pytest.mark.parametrize("seed", range(4))
def test_flipped_crop_keeps_its_parts_aligned(seed):
    frame = made_up(seen=True)
    frame.coverage[:] = frame.colour[:, :, 0]  # the same picture in all of them
    frame.shown[:] = frame.coverage
    frame.colour[:] = frame.coverage[:, :, None]
    frame.seen[:] = frame.coverage[0]
    crop = crop_of(frame, interest(frame, CONFIG["crop"]), np.random.default_rng(seed), CONFIG)
    assert crop.colour.shape == (3, 4, 3, 112, 112)
    assert torch.equal(crop.colour[:, :, 1], crop.coverage) and torch.equal(crop.shown, crop.coverage)
    assert torch.equal(crop.seen, crop.coverage[0])


def test_masks_are_the_programs_or_deliberately_wrong():
    frame, kept, bare, wrong = made_up(seen=False), 0, 0, 0
    for seed in range(60):
        found = masks(frame, np.random.default_rng(seed), CONFIG | {"cut": 0.0})
        kept += torch.equal(found, frame.shown.float())
        bare += bool((found == 1).all())
        changed = (found != frame.shown).float().mean()
        wrong += bool(0 < changed < 0.1)
    assert kept > 30 and bare > 0 and wrong > 0 and kept + bare + wrong == 60


def test_colour_changes_are_the_same_in_all_views():
    frame = made_up(seen=False)
    frame.colour[:] = frame.target
    found = recoloured(frame, np.random.default_rng(0))
    assert (found.target != frame.target).float().mean() > 0.5
    assert torch.equal(found.colour, found.target.expand_as(found.colour))


def test_cut_masks_a_single_view():
    frame = made_up(seen=False)
    for seed in range(8):
        found = masks(frame, np.random.default_rng(seed), CONFIG | {"cut": 1.0})
        assert sum(not torch.equal(a, b.float()) for a, b in zip(found[0], frame.shown[0], strict=True)) == 1


def test_loss_favours_the_views_that_see():
    torch.manual_seed(0)
    frame, config = made_up(seen=True), CONFIG | {"true_surface": 1.0}
    frame.seen[0], frame.seen[1:] = HIDDEN, SEEN
    crop = crop_of(frame, interest(frame, config["crop"]), np.random.default_rng(1), config)
    net = UNet(4).eval()
    optimiser = torch.optim.Adam(net.parameters(), 3e-3)
    first = None
    for _ in range(12):
        loss, figures = example_loss(net, crop, (0.1, 0.3), np.random.default_rng(3), config)
        first = first or figures
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    weights = [d**-VISIBLE_POWER for d in (1, 2, 2.5, 4)]
    assert abs(first["by distance"] - sum(weights[1:]) / sum(weights)) < 0.02
    assert figures["seen"] > first["seen"] + 0.05


def test_weights_by_distance_have_gain_0():
    net = UNet(4).eval()
    torch.nn.init.zeros_(net.conv9.weight), torch.nn.init.zeros_(net.conv9.bias)
    for seed in range(4):
        loss, figures = example_loss(net, made_up(seen=False), (0.1, 0.3), np.random.default_rng(seed), CONFIG)
        assert float(loss.detach()) == pytest.approx(1, abs=1e-6) and figures["gain"] == pytest.approx(0, abs=1e-6)


@pytest.mark.skipif(not PROGRAM.exists(), reason="the program is not built: make build")
def test_frame_renders_like_the_program(tmp_path):
    spec = {"path": "workshop", "width": None, "targets": [7, 8]}
    rig = held_out_rig(open_scene(ROOT / "tests/scenes/workshop"), spec, 7, 4)
    found = dumped(rig, PROGRAM, 4, 2, tmp_path)
    frame = frame_of(rig, found)
    frame.save(tmp_path / "frame.pt")
    frame = SurfaceFrame.load(tmp_path / "frame.pt")
    shown = frame.shown.float()
    colour, coverage = frame.colour / 255 * shown[:, :, None], frame.coverage / 255 * shown
    torch.testing.assert_close(colour.flatten(1, 2), found["colour"], atol=0.002, rtol=0)
    torch.testing.assert_close(coverage, found["coverage"], atol=0.002, rtol=0)
    with torch.no_grad():
        logits = load_network(ROOT / "models/liveview_v4.pt")(colour.flatten(1, 2))
    difference = (rendered(logits, colour, coverage, frame.distances) - found["frame"]).abs()
    # A byte is a step of 0.004, which a small coverage divides; uncovered pixels are inpainted by
    # the program.
    height, width = difference.shape[-2:]
    seen = coverage.amin(0).amax(0)[:height, :width] > 0.5
    assert seen.float().mean() > 0.9
    assert difference.mean() < 1e-3 and difference[:, seen].max() < 0.1
    assert 0.01 < float((frame.shown == 0).float().mean()) < 0.2


def test_mixture_is_between_its_networks(tmp_path, monkeypatch):
    first, second = ROOT / "models/liveview_v4.pt", ROOT / "models/liveview_v4_planes.onnx"
    nets = {}
    for share in (0.0, 0.25, 1.0):
        out = tmp_path / "out.pt"
        monkeypatch.setattr(sys, "argv", ["", str(first), str(second), str(out), "--share", str(share)])
        mix.main()
        nets[share] = load_network(out).conv9.weight
    torch.testing.assert_close(nets[0.0], load_network(first).conv9.weight)
    torch.testing.assert_close(nets[1.0], load_network(second).conv9.weight)
    torch.testing.assert_close(nets[0.25], 0.75 * nets[0.0] + 0.25 * nets[1.0])


def test_harmful_view_weights_are_fitted_to_0(tmp_path, monkeypatch):
    """The network prefers the nearest view by a constant, but the truth is the views'
    mean by distance."""
    torch.manual_seed(0)
    net = fold_batchnorm(UNet(4).eval())
    with torch.no_grad():
        net.conv9.bias[1:] -= torch.tensor([2.0, 3.0, 4.0])
    frame = made_up(seen=False)
    frame.shown.fill_(1)
    colour, coverage = frame.colour[:1] / 255, frame.coverage[:1] / 255
    truth = rendered(torch.zeros_like(coverage), colour, coverage, frame.distances)
    frame.target.copy_((truth * 255).round().to(torch.uint8))
    frame.save(tmp_path / "00000.pt")
    state = {"average": unfold_batchnorm(net).state_dict(), "views": 4, "config": {}}
    torch.save(state, tmp_path / "start")
    command = ["", str(tmp_path / "start"), str(tmp_path / "out.pt"), "--frames", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", command)
    fit_view_weights.main()
    made = load_state(tmp_path / "out.pt")
    assert made["config"]["view_weights"] == {"constant": 0.0, "varying": 0.4}
    before = fit_view_weights.first_layer(net, frame)[0]
    after = fit_view_weights.first_layer(trained_network(made), frame)[0]
    torch.testing.assert_close(after[:, 0], before[:, 0])
    varying = before[:, 1:] - before[:, 1:].mean((2, 3), keepdim=True)
    torch.testing.assert_close(after[:, 1:], 0.4 * varying, atol=1e-4, rtol=1e-4)
