"""Parity of a render of the example scene: nothing departs, and each planted fault does, at its
stage."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from toy_rigs import surface_rig

from liveview_ref.checkpoint import load_network
from liveview_ref.data.scene import write_scene
from liveview_ref.parity.compared import TOLERANCES, Compared
from liveview_ref.reference.surface import aggregate, correction, fusion, photo_depth, photo_sweep
from liveview_ref.rig_arrays import cameras_of, images_of

liveview = pytest.importorskip("liveview_ref.extension", exc_type=ImportError).liveview
from liveview_ref.parity import render, stages  # noqa: E402
from liveview_ref.parity import surface as surface_stages  # noqa: E402
from liveview_ref.parity.render import Rendered  # noqa: E402

ROOT = Path(__file__).parents[3]
SCENE = ROOT / "tests" / "scenes" / "workshop"
OPTIONS = {"network": False, "views": 4}

torch.set_num_threads(1)  # small arrays


@pytest.fixture(scope="module")
def surface() -> list[Rendered]:
    scenes = (liveview.Scene(SCENE, width=width) for width in (128, 64))
    return [Rendered.of(scene, "target_0", layers="surface:2", **OPTIONS) for scene in scenes]


@pytest.fixture(scope="module")
def guided() -> Rendered:
    return Rendered.of(liveview.Scene(SCENE, width=128), "target_0", layers="guided:2", **OPTIONS)


def changed(rendered: Rendered, **arrays) -> Rendered:
    found = {name.replace("__", "."): value for name, value in arrays.items()}
    assert found.keys() <= rendered.data.keys()
    return rendered._replace(data=rendered.data | found)


def departing(rendered: Rendered, reduced: Rendered | None = None) -> str | None:
    return next((row.name for row in render.rows(rendered, reduced, None, photos=1) if row.departs), None)


def test_nothing_departs_without_a_fault(surface, guided):
    assert departing(*surface) is None
    assert departing(guided) is None


# A wrong constant of a stage of the surface: Python has it, which is the same as Rust having it.
CONSTANTS = [
    ("coarse_costs", photo_sweep, "COLOUR", (0.5, 0.16)),
    ("coarse_found", aggregate, "JUMP_PENALTY", 0.121),
    ("coarse_sure", fusion, "AGREEMENT", 0.5),
    ("nearer", fusion, "HALF_SIDE", 0.25),  # the first stage that splats
    ("nearer", fusion, "EDGE", 2.0),
    ("nearer", fusion, "MOST_DIFFERENCE", 0.05),
    ("nearer", fusion, "LEAST_CONFIRMED", 0.9),
    ("splat", surface_stages, "FUSED", 1.0),
    ("anchored_costs", photo_depth, "ANCHOR_COST", 0.055),
    ("gains", correction, "MOST_VALUE", 0.6),
    ("rgb", stages, "CORRECTED_POWER", 3.0),  # the distance to a view counted twice
]


@pytest.mark.parametrize(("stage", "module", "name", "wrong"), CONSTANTS)
def test_a_wrong_constant_departs_at_its_stage(surface, monkeypatch, stage, module, name, wrong):
    monkeypatch.setattr(module, name, wrong)
    assert departing(*surface) == stage


# A wrong result of a function of the package.
RESULTS = [
    (
        "homography",
        liveview._stages,
        "source_from_target",
        lambda found: np.array(found) + [[0, 0, 0.5], [0] * 3, [0] * 3],
    ),
    ("neighbours", liveview._stages, "neighbours", lambda found: found[::-1]),
    ("confirmed", liveview, "confirmed", lambda found: np.roll(found, 1, 1)),
    ("nearer", liveview._stages, "nearer_edges", lambda found: np.roll(found, 1, 1)),
    ("filled", liveview, "fill_holes", lambda found: np.float32(1.001) * found),
]


@pytest.mark.parametrize(("stage", "module", "name", "wrong"), RESULTS)
def test_a_wrong_result_departs_at_its_stage(surface, monkeypatch, stage, module, name, wrong):
    right = getattr(module, name)
    monkeypatch.setattr(module, name, lambda *arguments: wrong(right(*arguments)))
    assert departing(*surface) == stage


def shifted(maps: np.ndarray) -> np.ndarray:
    """Half a pixel to the right."""
    return (maps + np.roll(maps, 1, -1)) / 2


def test_a_fault_in_a_render_departs_at_its_stage(surface, guided):
    full, small = surface
    data = full.data
    photos = data["shot.photos"].copy()
    photos[[1, 2]] = photos[[2, 1]]
    assert departing(changed(full, shot__photos=photos), small) == "views"
    assert departing(changed(full, shot__range=data["shot.range"] * [1, 1.001]), small) == "depth_range"
    planes = guided.data["coarse_disparities"] * 1.001
    assert departing(changed(guided, coarse_disparities=planes)) == "planes"
    assert departing(full, changed(small, depth0=shifted(small.data["depth0"]))) == "depth"
    assert departing(full, changed(small, pixel=small.data["pixel"] * np.float32(1.001))) == "pixel"
    assert departing(changed(full, gains=data["gains"] * np.float32(1.001)), small) == "gains"
    assert departing(changed(full, maps=data["maps"][::-1].copy()), small) == "layers"
    assert departing(changed(full, colour=shifted(data["colour"])), small) == "colour"
    assert departing(changed(full, used0=data["depth0"]), small) == "nearer"
    fewer = np.where(np.roll(data["used0"], 1, 1) >= 0, data["used0"], np.float32(-1))
    assert departing(changed(full, used0=fewer), small) == "sure"


def test_not_a_number_departs_without_a_traceback(guided):
    frame = guided.data["frame"].copy()
    frame[0, 3, 4] = np.nan
    broken = changed(guided, frame=frame)
    rows = {row.name: row for row in render.rows(broken, None, None)}
    assert departing(broken) == "frame"
    assert "| [0, 3, 4] | OFF |" in rows["frame"].row()


def test_the_lens_and_an_unknown_depth_range_are_computed_by_python(tmp_path):
    photos = surface_rig(np.random.default_rng(5), 5, "scene")
    cameras, _ = cameras_of(photos)
    images = images_of(photos, torch.float32)
    write_scene(tmp_path, images, cameras, lens={"k1": 0.02, "p1": 0.001})
    original, small = (
        Rendered.of(liveview.Scene(tmp_path, width=width), "000", network=False, views=2, layers="surface:1")
        for width in (None, 48)
    )
    undistorted = list(render.undistorted(original))
    found = list(render.depth_range(small, searched=True))
    assert len(undistorted) == 2 and [row.name for row in found] == ["depth_range", "searched_range"]
    assert not any(row.departs for row in [*undistorted, *found]), [row.row() for row in [*undistorted, *found]]
    moved = next(render.undistorted(changed(original, original0__k1=np.array(0.021))))
    assert moved.departs
    wider = next(render.depth_range(changed(small, shot__range=small.data["shot.range"] * 1.03), searched=True))
    assert wider.departs


def test_a_worse_torch_does_not_loosen_a_ceiling():
    for entry, tolerance in TOLERANCES.items():
        if entry == "comment":
            continue
        exact = np.ones(1000)
        off = exact + np.where(np.arange(1000) % 2, 3, -3) * (tolerance["ceiling"] + 1e-14)
        row = Compared.of("row", (off, exact, off * 1.5), entry)
        assert row.departs, entry
        assert "OFF, torch itself departs" in row.row(), entry


def test_weights_of_a_checkpoint_are_held_against_the_model(tmp_path):
    net = load_network(ROOT / "models" / "liveview_v4.onnx")
    [row] = render.weights(ROOT / "models" / "liveview_v4.onnx", net)
    assert not row.departs
    state = torch.load(ROOT / "models" / "liveview_v4.pt", weights_only=True)
    name = next(name for name, value in state["average"].items() if value.ndim == 4)
    state["average"][name] = state["average"][name] * 1.001
    torch.save(state, tmp_path / "liveview_v4.pt")
    [row] = render.weights(tmp_path / "liveview_v4.onnx", net)
    assert row.departs
    assert list(render.weights(tmp_path / "other.onnx", net)) == []


def test_a_reference_that_ends_the_program_is_an_error():
    """As if `raise SystemExit` stood in reference/surface/__init__.py."""
    script = f"""
import sys, importlib.abc
class End(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "liveview_ref.reference.surface":
            raise SystemExit
sys.meta_path.insert(0, End())
sys.argv = ["parity", {str(SCENE)!r}, "--target", "target_0", "--network", "none", "--width", "64"]
from liveview_ref.parity.__main__ import main
sys.exit(main())
"""
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT / "python", capture_output=True, text=True)
    assert done.returncode == 1
    assert "the reference ended the program" in done.stderr


def test_a_target_that_is_not_there_is_an_error():
    command = [sys.executable, "-m", "liveview_ref.parity", SCENE, "--target", "nobody", "--width", "64"]
    done = subprocess.run(command, cwd=ROOT / "python", capture_output=True, text=True)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("error: ") and "nobody" in done.stderr
