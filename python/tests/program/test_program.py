"""The scenes that the evaluation gives the package: the photos and cameras of the case, without
held-out ones."""

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
import torch

from liveview_ref.data.held_out import case_of
from liveview_ref.data.scene import open_scene
from liveview_ref.evaluation import evaluate
from liveview_ref.evaluation.program import TARGET, Program, write_scene
from liveview_ref.paper.methods import program
from liveview_ref.paper.methods.method import Photos

ROOT = Path(__file__).parents[3]
WORKSHOP = ROOT / "tests" / "scenes" / "workshop"
SPEC = {"width": None, "targets": [7, 8], "pool": [0, 1, 2, 3, 5], "near": 1, "far": 9}


class Fake(NamedTuple):
    """In place of the package's scene and synthesizer: renders its request as a picture: photos,
    layers, whether without a network."""

    photos: int
    layers: int = 0
    without: bool = False

    @classmethod
    def scene(cls, folder: Path) -> "Fake":
        return cls(len(json.loads((folder / "transforms.json").read_text())["frames"]))

    @classmethod
    def synthesizer(cls, scene: "Fake", *, layers: str, near: float, cache: Path, network=None, views=None, far=None):
        assert (network is None) != (views is None) and near == 1 and cache
        return cls(scene.photos, int(layers.split(":")[1]), network is None)

    def render(self, target: str) -> SimpleNamespace:
        assert target == TARGET
        return SimpleNamespace(picture=np.float32([[self, [0, 0, 0]]]))


@pytest.fixture
def fake(monkeypatch):
    liveview = pytest.importorskip("liveview_ref.extension", exc_type=ImportError).liveview
    monkeypatch.setattr(liveview, "Scene", Fake.scene)
    monkeypatch.setattr(liveview, "Synthesizer", Fake.synthesizer)


def test_written_scene_equals_the_case(tmp_path):
    scene = open_scene(WORKSHOP)
    case = case_of(scene, SPEC, 7, 4)
    write_scene(tmp_path, scene, SPEC, 7, case)
    written = open_scene(tmp_path)
    assert written.names == ["0000.png", "0001.png", "0002.png", "0003.png", "0005.png", TARGET], (
        "the other target is not"
    )
    for index, name in enumerate(written.names):
        original = 7 if name == TARGET else int(Path(name).stem)
        assert torch.equal(written.image_u8(index), scene.image_u8(original))
        assert written.bounds[index] == pytest.approx(scene.bounds[original])
        found, camera = written.cameras[index], scene.cameras[original]
        for part in ("k", "rotation", "translation"):
            torch.testing.assert_close(getattr(found, part), getattr(camera, part), rtol=0, atol=1e-9)


def test_every_row_is_rendered(fake):
    scene = open_scene(WORKSHOP)
    rows = dict(Program(Path("model.onnx")).surface(scene, SPEC, 7, case_of(scene, SPEC, 7, 4)))
    assert {name: image[:, 0, 0].tolist() for name, image in rows.items()} == {
        "surface:2": [6, 2, 0],
        "surface:1": [6, 1, 0],
        "surface:1, no network": [6, 1, 1],
        "surface:3, no network": [6, 3, 1],
    }


def test_paper_comparison_renders_as_many_layers_as_planes(fake, monkeypatch):
    scene = open_scene(WORKSHOP)
    case = case_of(scene, SPEC, 7, 4)
    photos, planes = Photos(case.sources, case.cameras, (0,)), torch.tensor([1.0, 0.5, 1 / 9])
    for build, without in ((program.surface, 0), (program.surface_without_network, 1)):
        rendering = build(4)(photos, case.target, planes)
        assert rendering.rgb[:, 0, 0].tolist() == [5, 3, without]
    monkeypatch.setattr(program, "MODELS", Path("no"))
    with pytest.raises(FileNotFoundError, match="liveview_v4.onnx is missing"):
        program.surface(4)


def test_without_the_package_surface_layers_are_skipped_unless_requested(tmp_path, monkeypatch, capsys):
    (tmp_path / "spec.json").write_text(json.dumps([{"path": "no", "targets": [0]}]))
    monkeypatch.setattr(evaluate, "load_lpips", lambda: None)
    monkeypatch.setattr(evaluate.baselines, "opencv", lambda: None)
    monkeypatch.setitem(sys.modules, "liveview_ref.extension", None)
    model, spec = ROOT / "models" / "liveview_v4.pt", tmp_path / "spec.json"
    command = ["", model, spec, "--data", tmp_path, "--out", tmp_path / "out"]
    threads = torch.get_num_threads()
    monkeypatch.setattr(sys, "argv", [str(x) for x in command])
    assert evaluate.main() == 1, "no scene"
    assert "skipped surface layers: import of liveview_ref.extension" in capsys.readouterr().err
    monkeypatch.setattr(sys, "argv", [str(x) for x in [*command, "--methods", "surface"]])
    with pytest.raises(SystemExit):
        evaluate.main()
    assert "surface layers are rendered by the package" in capsys.readouterr().err
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
