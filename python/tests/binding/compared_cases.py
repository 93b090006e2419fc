"""Seeded cases of the stages, and the comparison of Rust with float64 by the bounds of
parity/tolerances.json."""

import functools

import numpy as np
import torch

from liveview_ref.parity import stage_cases, stages, surface_cases, surface_stages
from liveview_ref.parity.live.compared import TOLERANCES, Compared
from liveview_ref.rig_arrays import cameras_of, images_of


def check(stage: str, rust, exact, float32, scaled: bool | None = None) -> None:
    """Rust's errors are within the bounds of the tolerance file, by the rule of `make parity`."""
    scaled = stage in stages.SCALED if scaled is None else scaled
    row = Compared.of(stage, tuple(np.asarray(found) for found in (rust, exact, float32)), scaled=scaled)
    assert not row.departs, row.row()


def both(function, *arguments, **options):
    """The results of the reference in float64 and float32."""

    def to(value, dtype):
        if isinstance(value, torch.Tensor) and value.is_floating_point():
            return value.to(dtype)
        if isinstance(value, tuple) and hasattr(value, "_fields"):
            return type(value)(*(to(item, dtype) for item in value))
        if isinstance(value, (list, tuple)):
            return type(value)(to(item, dtype) for item in value)
        return value

    return tuple(
        function(*(to(value, dtype) for value in arguments), **options) for dtype in (torch.float64, torch.float32)
    )


class Case:
    """A case of stage_cases.py, its arrays as float32 tensors, and cameras of the reference."""

    def __init__(self, name: str):
        self.data, self.oracle = stage_cases.case(name)
        self.cameras, self.target = cameras_of(self.data)
        self.images = images_of(self.data, torch.float32)
        arrays = ("maps", "logits", "coverage", "alpha", "rgb")
        self.maps, self.logits, self.coverage, self.alpha, self.rgb = (torch.from_numpy(self.data[x]) for x in arrays)
        self.colour = torch.from_numpy(self.data["colour"]).unflatten(1, (-1, 3))
        self.covered = (self.coverage > 0).any(1)

    def check(self, stage, **found) -> None:
        """Compares outputs of a stage with those of the oracle and of torch."""
        single = stage(self.data, torch.float32)
        for name, rust in found.items():
            check(name, rust, self.oracle[name], single[name])


@functools.cache
def case_of(name: str) -> Case:
    return Case(name)


class SurfaceCase(dict):
    """The arrays of a case of surface_cases.py: a stage's inputs, its outputs by the oracle,
    torch's errors, and which elements the last bits decide."""

    def __init__(self, name: str):
        arrays = surface_cases.case(list(surface_cases.CASES).index(name), **surface_cases.CASES[name])
        super().__init__({name: np.asarray(value, order="C") for name, value in arrays.items()})
        self.range = tuple(float(x) for x in self["range"])
        self.count = int(self["count"])
        self.views = surface_stages.photos(self, torch.float32)
        self.cameras, self.target = cameras_of(self)

    def each(self, name: str) -> list[np.ndarray]:
        """The arrays NAME0, NAME1 and so on, of one photo each."""
        found = [f"{name}{i}" for i in range(len(self.views))]
        return [self[one] for one in found if one in self]

    def neighbours(self, which: int) -> list[tuple]:
        return surface_stages.neighbours(self, which, torch.float32)

    def check(self, name: str, found) -> None:
        """Few elements may be doubtful; the errors of the others are within the bounds of the
        tolerance file, given torch's."""
        tolerance = TOLERANCES[f"surface {surface_cases.kind_of(name)}"]
        exact, (most, mean) = self[f"oracle.{name}"], self[f"torch.{name}"]
        found = np.asarray(found, np.float64)
        assert found.shape == exact.shape and np.isfinite(found).all(), name
        doubtful = self.get(f"doubtful.{name}", np.zeros(exact.shape, bool))
        assert doubtful.mean() <= tolerance.get("doubtful", 0), name
        off = np.abs(found - exact)[~doubtful]
        assert off.max() <= min(max(tolerance["floor"], tolerance["max_factor"] * most), tolerance["ceiling"]), name
        most_mean = max(tolerance["mean_floor"], tolerance["mean_factor"] * mean) * (1 + 1e-9)
        assert off.mean() <= min(most_mean, tolerance["ceiling"]), name

    def check_each(self, name: str, found) -> None:
        """Of the arrays NAME0, NAME1 and so on."""
        for i, one in enumerate(found):
            self.check(f"{name}{i}", one)
        assert f"{name}{len(found)}" not in self


@functools.cache
def surface_case(name: str) -> SurfaceCase:
    return SurfaceCase(name)
