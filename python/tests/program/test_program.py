"""What the evaluation gives the library: the photos and cameras of the case, without held-out
ones."""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from liveview_ref.data.held_out import case_of
from liveview_ref.data.scene import open_scene
from liveview_ref.evaluation import evaluate
from liveview_ref.evaluation.program import rendered, surface
from liveview_ref.paper.methods import program
from liveview_ref.paper.methods.method import Photos

ROOT = Path(__file__).parents[3]
WORKSHOP = ROOT / "tests" / "scenes" / "workshop"
SPEC = {"width": None, "targets": [7, 8], "pool": [0, 1, 2, 3, 5], "near": 1, "far": 9}


class Fake:
    """In place of the Python package: the picture holds the number of photos, the layers, and
    whether there is no network."""

    class Synthesizer:
        def __init__(self, scene, *, views, layers, network, near, far, cache=None):
            assert views == 4 and near == 1
            self.shown = len(scene), int(layers.split(":")[1]), network is None

        def render(self, target):
            frame = np.zeros((target.height, target.width, 3), np.float32)
            frame[0, :3, 0] = self.shown
            return SimpleNamespace(raw=frame)


@pytest.fixture
def fake(monkeypatch):
    given = []

    def in_memory(photos: list, cameras: list) -> list:
        given[:] = zip(photos, cameras, strict=True)
        return given

    monkeypatch.setitem(sys.modules, "liveview_ref.extension", SimpleNamespace(liveview=Fake, in_memory=in_memory))
    return given


def test_every_row_is_rendered_from_the_photos_of_the_pool(fake):
    scene = open_scene(WORKSHOP)
    rows = surface(Path("model.onnx"), scene, SPEC, case_of(scene, SPEC, 7, 4))
    assert {name: image[0, 0, :3].tolist() for name, image in rows} == {
        "surface:2": [5, 2, 0],
        "surface:1": [5, 1, 0],
        "surface:1, no network": [5, 1, 1],
        "surface:3, no network": [5, 3, 1],
    }


def test_photos_are_given_as_8_bits_with_their_cameras(fake):
    case = case_of(open_scene(WORKSHOP), SPEC, 7, 4)
    rendered(case.sources, case.cameras, case.target, views=4, layers="surface:1", network=None, near=1, far=9)
    for (photo, camera), source, expected in zip(fake, case.sources, case.cameras, strict=True):
        assert photo.dtype == np.uint8 and np.abs(photo / 255 - source.permute(1, 2, 0).numpy()).max() < 0.51 / 255
        assert camera is expected


def test_paper_comparison_renders_as_many_layers_as_planes(fake):
    case = case_of(open_scene(WORKSHOP), SPEC, 7, 4)
    photos, planes = Photos(case.sources, case.cameras, (0,)), torch.tensor([1.0, 0.5, 1 / 9])
    for build, without in ((program.surface, 0), (program.surface_without_network, 1)):
        rendering = build(4)(photos, case.target, planes)
        assert rendering.rgb[0, 0, :3].tolist() == [4, 3, without]


def test_without_the_package_surface_layers_are_skipped_unless_requested(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "liveview_ref.extension", None)  # its import fails
    monkeypatch.setenv("RAYON_NUM_THREADS", "1")
    with pytest.raises(FileNotFoundError, match="not built yet"):
        program.surface(4)
    (tmp_path / "spec.json").write_text(json.dumps([{"path": "no", "targets": [0]}]))
    monkeypatch.setattr(evaluate, "load_lpips", lambda: None)
    monkeypatch.setattr(evaluate.baselines, "opencv", lambda: None)
    model, spec = ROOT / "models" / "liveview_v4.pt", tmp_path / "spec.json"
    command = ["", model, spec, "--data", tmp_path, "--out", tmp_path / "out"]
    threads = torch.get_num_threads()
    monkeypatch.setattr(sys, "argv", [str(x) for x in command])
    assert evaluate.main() == 1, "no scene"
    assert "skipped surface layers: import of liveview_ref.extension halted" in capsys.readouterr().err
    monkeypatch.setattr(sys, "argv", [str(x) for x in [*command, "--methods", "surface"]])
    with pytest.raises(SystemExit):
        evaluate.main()
    assert "import of liveview_ref.extension halted" in capsys.readouterr().err
    torch.set_num_threads(threads)


@pytest.mark.parametrize("power", [1.0, 1.5])
def test_zero_logits_give_weights_by_distance_alone(power):
    from liveview_ref.reference.liveview import blend

    colour = torch.rand(1, 3, 3, 4, 5, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    seen = torch.ones(1, 3, 4, 5, dtype=torch.float64)
    seen[0, 1, :2] = 0
    distances = torch.tensor([1.0, 2.0, 4.0], dtype=torch.float64)
    colour = colour * seen[:, :, None]
    _, rgb = blend(torch.zeros(1, 3, 4, 5, dtype=torch.float64), colour, seen, distances, power)
    weights = seen / distances[:, None, None] ** power
    expected = (weights[:, :, None] * colour).sum(1) / weights.sum(1, keepdim=True)
    np.testing.assert_allclose(rgb.numpy(), expected.numpy(), atol=1e-12)
