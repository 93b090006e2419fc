"""The text form of layers, the same on command lines, in tables, reports and model cards.

- `planes:64`: 64 planes, evenly spaced in disparity
- `guided:2`: 2 layers that follow the scene; `guided:2/32`: found by a first search of 32 planes
- `surface:2`: 2 layers along the surface, from the depth of the photos
- `select:16/64`: the 16 of 64 planes that are best for most pixels (the paper's selection);
  `select:16` is of 64
- `list:0.5,0.25,0`: planes at these disparities, near -> far
"""

import argparse
import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

SELECT_FROM = 64  # planes that `select:16` selects from
EXPECTED = "planes:64, guided:2, guided:2/32, surface:2, select:16/64 or list:0.5,0.25,0"


@dataclass(frozen=True)
class _Counted:
    count: int

    def __str__(self) -> str:
        return f"{type(self).__name__.lower()}:{self.count}"


class Planes(_Counted):
    """`count` planes, evenly spaced in disparity from near to far."""


class Surface(_Counted):
    """`count` layers along the surface, from the depth of the photos."""


@dataclass(frozen=True)
class Guided(_Counted):
    """`count` layers that follow the scene; `coarse_planes` in the first search, None: by
    the parallax."""

    coarse_planes: int | None = None

    def __str__(self) -> str:
        return super().__str__() + ("" if self.coarse_planes is None else f"/{self.coarse_planes}")


@dataclass(frozen=True)
class Select(_Counted):
    """The `count` fullest of `planes` planes."""

    planes: int

    def __str__(self) -> str:
        return f"{super().__str__()}/{self.planes}"


@dataclass(frozen=True)
class DisparityList:
    """Planes at these disparities (1 / scene unit), descending: near -> far."""

    disparities: tuple[float, ...]

    def __str__(self) -> str:
        return "list:" + ",".join(np.format_float_positional(d, trim="-") for d in self.disparities)


LayerSpec = Planes | Guided | Surface | Select | DisparityList


def parse(text: str) -> LayerSpec:
    """The layers that a string names; `str` reverses it. ValueError states what was expected."""
    kind, _, rest = text.strip().partition(":")
    try:
        match kind:
            case "planes":
                return Planes(_count(rest))
            case "surface":
                return Surface(_count(rest))
            case "guided":
                count, coarse_planes = _two_counts(rest)
                if coarse_planes is not None and coarse_planes < 2:
                    raise ValueError("the first search needs at least 2 planes")
                return Guided(count, coarse_planes)
            case "select":
                count, planes = _two_counts(rest)
                planes = SELECT_FROM if planes is None else planes
                if count > planes:
                    raise ValueError("cannot select more planes than there are")
                return Select(count, planes)
            case "list":
                return DisparityList(_disparities(rest))
    except ValueError as error:
        raise ValueError(f'layers "{text}": {error}; expected one like {EXPECTED}') from error
    raise ValueError(f'layers "{text}": expected one like {EXPECTED}')


def argument(text: str) -> LayerSpec:
    """`parse` as an argparse type; argparse then prints the error message unchanged."""
    try:
        return parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit()) or int(text) == 0:
        raise ValueError(f'"{text}" is not a positive whole number')
    return int(text)


def _two_counts(text: str) -> tuple[int, int | None]:
    first, slash, second = text.partition("/")
    return _count(first), _count(second) if slash else None


def _disparities(text: str) -> tuple[float, ...]:
    found = tuple(float(item) + 0.0 for item in text.split(","))  # -0 becomes 0
    if not all(math.isfinite(d) and d >= 0 for d in found) or not all(a > b for a, b in pairwise(found)):
        raise ValueError("disparities must be finite, not negative and descending")
    return found
