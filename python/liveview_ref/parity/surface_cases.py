"""Seeded cases of surface layers, for python/tests/binding: each stage's float64 oracle, and
float32 torch's errors.

As in stage_cases.py, a stage's inputs are the float32 roundings of the oracle's outputs of the
previous stage. `doubtful.NAME` marks the elements whose decision (a winner, the pixel a point falls
into, an occlusion) depends on the last bits: the oracle's own result changes when cameras, photos
and maps move by about 1e-6 of their values in either direction.
"""

import numpy as np
import torch

from ..reference.surface.photo_depth import NEIGHBOURS, planes_of
from ..rig_arrays import Arrays, cameras_of
from . import surface_stages as stages
from .surface_rigs import surface_rig

MOVED = 1e-6  # standard deviation of the moves of inputs: 8 units in the last place of 1
MOVE_PAIRS = {stages.depths: 1, stages.surfaces: 4}  # pairs of opposite moves tried; two for the other stages
DECISIONS = {  # the change of an output that means another decision; the other outputs change smoothly
    "half_costs": 1.5,  # units of 1/32768
    "half_found": 0.05,  # indices
    "half_index": 0.05,
    "starts": 0.5,
    "fine_costs": 1.5,
    "fine_found": 0.05,
    "fine_index": 0.05,
    "coarse": 0.1,  # 0.05 indices
    "coarse_sure": 0.5,
    "kept": 0.5,
    "anchor": 0.001,
    "anchored_costs": 1.5,
    "anchored": 0.025,
    "depth": 0.025,  # pixels of parallax, as for all IN_PIXELS: 0.05 indices
    "splat": 0.001,
    "filled": 0.001,
    "target_costs": 1e-5,  # variances, and costs of a tenth and less
    "searched": 0.01,
    "surface": 0.01,
    "layers": 0.01,
    "confirmed": 0.5,
    "nearer": 0.025,
    "sure": 0.5,
    "visible": 0.5,
    "seen": 0.5,
    "hidden_colour": 0.001,
    "hidden_coverage": 0.01,
    "photo_variance": 1e-5,  # of at most 0.02
    "gains": 1e-3,
    "sharpening": 1e-4,
}
IN_PHOTO_PIXELS = "depth", "coarse", "anchor", "anchored", "nearer"
IN_PIXELS = *IN_PHOTO_PIXELS, "splat", "filled", "searched", "surface", "layers"

CASES: dict[str, dict] = {
    "scene": {"views": 5},
    "many": {"views": 7},
    "sizes": {"views": 4, "kind": "sizes"},
    "one_neighbour": {"views": 2},
    "rectified": {"views": 4, "kind": "rectified"},
    "identical": {"views": 3, "kind": "identical", "still": True},
    "flat": {"views": 3, "kind": "flat"},
    "exposure": {"views": 3, "kind": "exposure"},
    "infinity": {"views": 3, "range": (2.0, np.inf)},
    "near_is_far": {"views": 3, "range": (5.0, 5.0 * (1 + 1e-6))},
    "moving": {"views": 4, "kind": "moving", "range": (1.0, np.inf), "at_target": False},
    "wide": {"views": 3, "range": (0.5, 9.0), "at_target": False},
    "planes_4096": {"views": 3, "count": 4096},
}


def kind_of(name: str) -> str:
    """Stages of one kind share a bound: depth0, depth1 ... are of the kind depth."""
    return name.rstrip("0123456789")


def decision_of(name: str, data: Arrays) -> float | None:
    """The change of an element, in its own unit, that means another decision; None if
    it decides nothing."""
    change = DECISIONS.get(kind_of(name))
    if kind_of(name) not in IN_PIXELS:
        return change
    pixel = data["pixel"][0] if kind_of(name) in IN_PHOTO_PIXELS else stages.target_pixel(data)
    # Not less than the moves can change where the nearest and the farthest almost coincide: four
    # standard deviations.
    return max(change * float(pixel), 4 * MOVED * float(np.abs(data[name]).max()))


def moved(data: Arrays, rng: np.random.Generator, sign: int, inputs: set[str]) -> Arrays:
    """The data with cameras, photos and float32 maps moved by about 1e-6."""
    found = dict(data)
    for name in sorted(inputs):
        value = data[name]
        noise = sign * MOVED * rng.standard_normal(value.shape)
        if name.endswith(".image"):
            found[name] = (value + noise).astype(np.float64)
        elif (name.endswith((".k", ".translation")) and not data["still"]) or (
            value.dtype == np.float32 and name != "pixel"
        ):
            found[name] = value * (1 + noise)
    return found


def doubtful(stage: stages.Stage, data: Arrays, oracle: Arrays) -> Arrays:
    """`doubtful.NAME` of each output of the stage whose elements are decisions."""
    found = {
        f"doubtful.{name}": np.zeros(np.shape(oracle[name]), bool) for name in oracle if kind_of(name) in DECISIONS
    }
    if not found:
        return {}
    inputs = {name for name in data if "." not in name or name.startswith(("view", "target"))}
    for pair in range(MOVE_PAIRS.get(stage, 2)):
        for sign in (1, -1):
            apart = stage(moved(data, np.random.default_rng([14, pair]), sign, inputs), torch.float64)
            for name, value in oracle.items():
                if f"doubtful.{name}" in found:
                    off = np.abs(apart[name].astype(np.float64) - value) > decision_of(name, data | oracle)
                    found[f"doubtful.{name}"] |= off
    return found


def errors(found: np.ndarray, oracle: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
    """Largest and mean absolute error over the elements that are not doubtful."""
    difference = np.abs(found.astype(np.float64) - oracle)
    assert np.isfinite(difference).all()
    sure = difference if mask is None else difference[~mask]
    return np.array([sure.max(), sure.mean()] if sure.size else [0.0, 0.0])


def case(
    seed: int,
    views: int,
    kind: str = "scene",
    range=(2.0, 9.0),  # noqa: A002
    count=None,
    still=False,
    at_target=True,
):
    """All arrays of a case. `still`: the cameras are not moved, because the case tests
    their exact poses. `at_target`: with the stages at the target."""
    data = surface_rig(np.random.default_rng([2021, 14, seed]), views, kind)
    if count:
        data |= {name: value[:24, :40] for name, value in data.items() if name.endswith(".image")}
    data |= {"range": np.array(range), "still": np.array(still)}
    cameras, _ = cameras_of(data)
    grid, _ = planes_of(cameras[0], cameras[1 : 1 + NEIGHBOURS], *range)
    data["count"] = np.array(count or grid.count)
    results = {}
    run = stages.STAGES if at_target else (*stages.PHOTO, stages.depths, *stages.ANCHORS)
    for stage in stages.PHOTO[:4] if count else run:
        oracle = stage(data, torch.float64)
        masks = doubtful(stage, data, oracle)
        for name, single in stage(data, torch.float32).items():
            results[f"torch.{name}"] = errors(single, oracle[name], masks.get(f"doubtful.{name}"))
        results |= masks | {f"oracle.{name}": value.astype(np.float64) for name, value in oracle.items()}
        data |= {name: value.astype(stages.INTEGERS.get(name, np.float32)) for name, value in oracle.items()}
    return data | results
