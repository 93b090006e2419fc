"""Parity of a render of the example scene: nothing departs, and each planted fault does, at its
stage."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from liveview_ref.checkpoint import load_network
from liveview_ref.data.written_scene import write_scene
from liveview_ref.parity import stages, surface_stages
from liveview_ref.parity.live import run, scene
from liveview_ref.parity.live.compared import TOLERANCES, Compared
from liveview_ref.parity.surface_rigs import surface_rig
from liveview_ref.paths import BINARY
from liveview_ref.reference.surface import aggregate, correction, fusion, photo_depth, photo_sweep
from liveview_ref.rig_arrays import cameras_of, images_of

ROOT = Path(__file__).parents[3]
SCENE = ROOT / "tests" / "scenes" / "workshop"
OPTIONS = ["--target", "target_0", "--network", "none", "--views", "4"]

torch.set_num_threads(1)  # small arrays

needs_program = pytest.mark.skipif(not BINARY.exists(), reason="needs `make build`")


@pytest.fixture(scope="module")
def surface() -> tuple[run.Dump, run.Dump]:
    of = [*OPTIONS, "--layers", "surface:2"]
    return run.Dump.of(BINARY, SCENE, [*of, "--width", "128"]), run.Dump.of(
        BINARY, SCENE, [*of, "--width", "64", "--search"]
    )


@pytest.fixture(scope="module")
def guided() -> run.Dump:
    return run.Dump.of(BINARY, SCENE, [*OPTIONS, "--layers", "guided:2", "--width", "128"])


def changed(dump: run.Dump, **arrays) -> run.Dump:
    return dump._replace(data=dump.data | {name.replace("__", "."): value for name, value in arrays.items()})


def departing(dump: run.Dump, reduced: run.Dump | None = None) -> str | None:
    return run.first_departing(run.rows(dump, reduced, None, photos=1))


@needs_program
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


@needs_program
@pytest.mark.parametrize(("stage", "module", "name", "wrong"), CONSTANTS)
def test_a_wrong_constant_departs_at_its_stage(surface, monkeypatch, stage, module, name, wrong):
    monkeypatch.setattr(module, name, wrong)
    assert departing(*surface) == stage


def shifted(maps: np.ndarray) -> np.ndarray:
    """Half a pixel to the right."""
    return (maps + np.roll(maps, 1, -1)) / 2


@needs_program
def test_a_fault_in_a_dump_departs_at_its_stage(surface, guided):
    full, small = surface
    data = full.data
    photos = data["shot.photos"].copy()
    photos[[1, 2]] = photos[[2, 1]]
    assert departing(changed(full, shot__photos=photos), small) == "views"
    assert departing(changed(full, shot__range=data["shot.range"] * [1, 1.001]), small) == "depth_range"
    planes = guided.data["coarse_disparities"] * 1.001
    assert departing(changed(guided, coarse_disparities=planes)) == "planes"
    homography = data["homography"].copy()
    homography[:, 0, 0, 2] += 0.5
    assert departing(changed(full, homography=homography), small) == "homography"
    assert (
        departing(full, changed(small, **{"search0.neighbours": small.data["search0.neighbours"][::-1]}))
        == "neighbours"
    )
    assert departing(changed(full, gains=data["gains"] * np.float32(1.001)), small) == "gains"
    assert departing(changed(full, maps=data["maps"][::-1]), small) == "layers"
    assert departing(changed(full, colour=shifted(data["colour"])), small) == "colour"
    assert departing(changed(full, confirmed0=np.roll(data["confirmed0"], 1, 1)), small) == "confirmed"
    assert departing(changed(full, nearer0=data["depth0"]), small) == "nearer"
    assert departing(changed(full, sure0=np.roll(data["sure0"], 1, 1)), small) == "sure"


@needs_program
def test_not_a_number_departs_without_a_traceback(guided):
    frame = guided.data["frame"].copy()
    frame[0, 3, 4] = np.nan
    broken = changed(guided, frame=frame)
    rows = {row.name: row for row in run.rows(broken, None, None)}
    assert departing(broken) == "frame"
    assert "| [0, 3, 4] | OFF |" in rows["frame"].row()


@needs_program
def test_the_lens_and_an_unknown_depth_range_are_computed_by_python(tmp_path):
    photos = surface_rig(np.random.default_rng(5), 5, "scene")
    cameras, _ = cameras_of(photos)
    images = images_of(photos, torch.float32)
    write_scene(tmp_path, images, cameras, lens={"k1": 0.02, "p1": 0.001})
    options = ["--network", "none", "--views", "2", "--layers", "surface:1", "--target", "000"]
    original = run.Dump.of(BINARY, tmp_path, options)
    dump = run.Dump.of(BINARY, tmp_path, [*options, "--search", "--width", "48"])
    [undistorted] = scene.undistorted(original.data)
    found = list(scene.depth_range(dump.data, searched=True))
    assert [row.name for row in found] == ["depth_range", "searched_range"]
    assert not any(row.departs for row in [undistorted, *found]), [row.row() for row in [undistorted, *found]]
    [moved] = scene.undistorted(original.data | {"original0.k1": np.array(0.021)})
    assert moved.departs
    [wider, _] = scene.depth_range(dump.data | {"shot.range": dump.data["shot.range"] * 1.03}, searched=True)
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
    [row] = run.weights(ROOT / "models" / "liveview_v4.onnx", net)
    assert not row.departs
    state = torch.load(ROOT / "models" / "liveview_v4.pt", weights_only=True)
    name = next(name for name, value in state["average"].items() if value.ndim == 4)
    state["average"][name] = state["average"][name] * 1.001
    torch.save(state, tmp_path / "liveview_v4.pt")
    [row] = run.weights(tmp_path / "liveview_v4.onnx", net)
    assert row.departs
    assert list(run.weights(tmp_path / "other.onnx", net)) == []


@needs_program
def test_a_reference_that_ends_the_program_is_an_error(tmp_path):
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
