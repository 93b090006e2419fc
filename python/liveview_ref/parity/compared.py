"""Errors of Rust and of float32 torch against the oracle, and the verdict on them."""

import json
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np
import torch

from ..paths import ROOT

BOTH = torch.float64, torch.float32
SCALED = (
    *("homography", "coarse_disparity", "fine_layers", "fine_disparity", "range", "cell_maps", "maps", "logits"),
    *("disparity", "anchor", "nearer", "splat", "filled", "surface", "layers"),
)  # errors relative to the largest element of the oracle
TOLERANCES = json.loads((ROOT / "parity" / "tolerances.json").read_text())
# Decisions (a winner, an occlusion) that may differ by rounding although torch's do not:
FEW = 2, 1e-4  # this many elements, and this share of them


class Errors(NamedTuple):
    """Largest and mean absolute error over the elements whose decision is the oracle's, where the
    largest is, and the number of the other elements."""

    largest: float
    mean: float
    where: tuple[int, ...]
    others: int

    @classmethod
    def of(cls, found: np.ndarray, exact: np.ndarray, scaled: bool, decision: float) -> "Errors":
        """`scaled`: relative to the oracle's largest element. `decision`: the error above which an
        element was decided otherwise."""
        if found.shape != exact.shape:
            return cls(np.inf, np.inf, (), found.size)
        found, exact = found.astype(np.float64), exact.astype(np.float64)
        with np.errstate(invalid="ignore"):
            difference = np.where(found == exact, 0, np.abs(found - exact))
        difference = np.nan_to_num(difference, nan=np.inf, posinf=np.inf)
        difference /= (np.abs(exact).max(initial=0) or 1) if scaled else 1
        other = (difference > decision) & np.isfinite(found)
        sure = np.where(other, 0, difference)
        if not sure.size:
            return cls(0.0, 0.0, (), 0)
        where = tuple(int(i) for i in np.unravel_index((difference if other.any() else sure).argmax(), sure.shape))
        return cls(float(sure.max()), float(sure.sum() / max((~other).sum(), 1)), where, int(other.sum()))

    def joined(self, more: "Errors", weights: tuple[int, int]) -> "Errors":
        """Those of two maps of so many elements."""
        worse = more if (more.others, more.largest) > (self.others, self.largest) else self
        mean = (self.mean * weights[0] + more.mean * weights[1]) / max(sum(weights), 1)
        return Errors(max(self.largest, more.largest), mean, worse.where, self.others + more.others)


def took(name: str, exact: np.ndarray) -> tuple[int, int] | None:
    """Of decisions: how many elements decide for (or have a disparity), and how many against."""
    if exact.dtype != bool and name not in ("anchor", "splat"):
        return None
    count = int((exact if exact.dtype == bool else exact >= 0).sum())
    return count, exact.size - count


class Compared(NamedTuple):
    """An output of a stage: its name in the table, its entry of the tolerance file, the number of
    its elements, the errors of Rust and of torch, and of decisions how many are for and against."""

    name: str
    entry: str
    elements: int
    ours: Errors
    theirs: Errors
    took: tuple[int, int] | None = None

    @classmethod
    def of(cls, name: str, found: tuple[np.ndarray, ...], entry: str | None = None, scaled: bool = False) -> "Compared":
        """`found`: by Rust, by the oracle, by torch. Where a stage makes decisions, an error above
        its `decision`, or else its ceiling, is another decision."""
        tolerance = TOLERANCES[entry or name]
        decision = tolerance.get("decision", tolerance["ceiling"]) if "doubtful" in tolerance else np.inf
        rust, exact, single = (np.asarray(x) for x in found)
        errors = (Errors.of(x, exact, scaled, decision) for x in (rust, single))
        return cls(name, entry or name, exact.size, *errors, took(name, exact))

    def joined(self, more: "Compared") -> "Compared":
        weights = self.elements, more.elements
        both = self.ours.joined(more.ours, weights), self.theirs.joined(more.theirs, weights)
        kinds = [one.took or (one.elements, 0) for one in (self, more)]
        took = tuple(map(sum, zip(*kinds, strict=True))) if self.took or more.took else None
        return self._replace(elements=sum(weights), ours=both[0], theirs=both[1], took=took)

    @property
    def departs(self) -> bool:
        largest, mean, others = limits(self)
        return not (self.ours.largest <= largest and self.ours.mean <= mean and self.ours.others <= others)

    def row(self) -> str:
        """Its line of the table; whether torch itself departs is judged by the ceiling alone."""
        tolerance, theirs = TOLERANCES[self.entry], self.theirs
        torch_departs = not (theirs.largest <= tolerance["ceiling"] and theirs.others <= few(self))
        verdict = ("OFF" if self.departs else "ok") + (", torch itself departs" if torch_departs else "")
        where = ", ".join(str(i) for i in self.ours.where)
        errors = f"{self.ours.largest:.1e} | {self.theirs.largest:.1e} | {self.ours.mean:.1e} | {self.theirs.mean:.1e}"
        others = f"{self.ours.others} | {self.theirs.others}"
        kinds = f"{self.took[0]}, {self.took[1]}" if self.took else ""
        return f"| {self.name} | {self.elements} | {errors} | {others} | {kinds} | [{where}] | {verdict} |"

    @property
    def is_one_sided(self) -> bool:
        """Whether all its decisions are the same."""
        return self.took is not None and 0 in self.took


HEAD = (
    "| stage | elements | Rust max | torch max | Rust mean | torch mean | Rust decides otherwise | torch does "
    "| decided for, against | worst at | |\n|---|---|---|---|---|---|---|---|---|---|---|"
)


def few(compared: Compared) -> float:
    """The number of decisions that may always differ from the oracle's; none where a stage makes
    none."""
    doubtful = TOLERANCES[compared.entry].get("doubtful", 0) * compared.elements
    return min(FEW[0] + FEW[1] * compared.elements, doubtful)


def limits(compared: Compared) -> tuple[float, float, float]:
    """Largest and mean error, and number of other decisions, allowed given torch's."""
    tolerance, theirs = TOLERANCES[compared.entry], compared.theirs
    largest = max(tolerance["floor"], tolerance["max_factor"] * theirs.largest)
    mean = max(tolerance["mean_floor"], tolerance["mean_factor"] * theirs.mean)
    others = min(2 * theirs.others, tolerance.get("doubtful", 0) * compared.elements)
    # Means are summed in another order: equal errors must count as equal.
    mean, ceiling = mean * (1 + 1e-9), tolerance["ceiling"]
    return min(largest, ceiling), min(mean, ceiling), max(others, few(compared))


def in_dtype(value, dtype: torch.dtype):
    """Arguments of the reference, the float32 arrays in them as tensors of this type."""
    if isinstance(value, np.ndarray):
        value = torch.from_numpy(value.astype(np.int64) if value.dtype == np.uint16 else value)
    if isinstance(value, torch.Tensor):
        return value.to(dtype) if value.dtype == torch.float32 else value
    if isinstance(value, (list, tuple)):
        items = [in_dtype(item, dtype) for item in value]
        return type(value)(*items) if hasattr(value, "_fields") else type(value)(items)
    return value


def row(name: str, rust: np.ndarray, reference: Callable, *arguments, entry: str | None = None) -> Compared:
    """What Rust and the reference make of the same arguments."""
    return next(rows((name,), (rust,), lambda *given: (reference(*given),), *arguments, entry=entry))


def rows(names: Iterable[str], rust: Iterable, reference: Callable, *arguments, entry=None) -> Iterator[Compared]:
    """As row, of each of the results; {} in `entry` is its name."""
    exact, single = (reference(*in_dtype(arguments, dtype)) for dtype in BOTH)
    for name, *found in zip(names, rust, exact, single, strict=True):
        yield Compared.of(name, tuple(found), entry and entry.format(name), name in SCALED)


def exact(name: str, found, expected, entry: str = "choice") -> Compared:
    """Something that is computed in float64 in both languages."""
    return Compared.of(name, (found, expected, expected), entry, scaled=True)


def joined(rows: Iterable[Compared]) -> Iterator[Compared]:
    """Rows of one name as one."""
    found: dict[str, Compared] = {}
    for one in rows:
        found[one.name] = found[one.name].joined(one) if one.name in found else one
    yield from found.values()
