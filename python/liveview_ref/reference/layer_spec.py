"""Which layers to render on, as one kind of string: on command lines, in tables, reports and model cards.

- `planes:64`: 64 planes, evenly spaced in disparity
- `guided:2`: 2 layers that follow the scene; `guided:2/32`: found by a coarse pass of 32 planes
- `surface:2`: 2 layers along the surface that the photos' own depth gives
- `select:16/64`: of 64 planes the 16 that most pixels choose (the paper's selection); `select:16` is of 64
- `kmeans:16`: 16 planes, k-means over the disparities that the coarse pass finds; `kmeans:16/32` as above
- `list:0.5,0.25,0`: planes at these disparities, near -> far
"""

import argparse
import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

SELECT_FROM = 64  # planes, where select:16 does not say
EXPECTED = "planes:64, guided:2, guided:2/32, surface:2, select:16/64, kmeans:16, kmeans:16/32 or list:0.5,0.25,0"


@dataclass(frozen=True)
class Planes:
    """`count` planes, evenly spaced in disparity from near to far."""

    count: int

    def __str__(self) -> str:
        return f"planes:{self.count}"


@dataclass(frozen=True)
class Guided:
    """`count` layers that follow the scene; `coarse_planes` of the coarse pass, None: by the parallax."""

    count: int
    coarse_planes: int | None = None

    def __str__(self) -> str:
        return f"guided:{self.count}{_after_slash(self.coarse_planes)}"


@dataclass(frozen=True)
class Surface:
    """`count` layers along the surface that the photos' own depth gives."""

    count: int

    def __str__(self) -> str:
        return f"surface:{self.count}"


@dataclass(frozen=True)
class Select:
    """The `count` fullest of `planes` planes."""

    count: int
    planes: int

    def __str__(self) -> str:
        return f"select:{self.count}/{self.planes}"


@dataclass(frozen=True)
class KMeans:
    """`count` planes where the coarse pass finds the scene; `coarse_planes` as of Guided."""

    count: int
    coarse_planes: int | None = None

    def __str__(self) -> str:
        return f"kmeans:{self.count}{_after_slash(self.coarse_planes)}"


@dataclass(frozen=True)
class DisparityList:
    """Planes at these disparities (1 / scene unit), descending: near -> far."""

    disparities: tuple[float, ...]

    def __str__(self) -> str:
        return "list:" + ",".join(np.format_float_positional(d, trim="-") for d in self.disparities)


LayerSpec = Planes | Guided | Surface | Select | KMeans | DisparityList


def parse(text: str) -> LayerSpec:
    """The layers that a string names; `str` of them is the string again. ValueError says what was expected."""
    kind, _, rest = text.strip().partition(":")
    try:
        match kind:
            case "planes":
                return Planes(_count(rest))
            case "surface":
                return Surface(_count(rest))
            case "guided" | "kmeans":
                count, coarse_planes = _two_counts(rest)
                if coarse_planes is not None and coarse_planes < 2:
                    raise ValueError("a coarse pass needs at least 2 planes")
                return (Guided if kind == "guided" else KMeans)(count, coarse_planes)
            case "select":
                count, planes = _two_counts(rest)
                planes = SELECT_FROM if planes is None else planes
                if count > planes:
                    raise ValueError("how many planes, of at least as many")
                return Select(count, planes)
            case "list":
                return DisparityList(_disparities(rest))
    except ValueError as error:
        raise ValueError(f'layers "{text}": {error}; expected such as {EXPECTED}') from error
    raise ValueError(f'layers "{text}": expected such as {EXPECTED}')


def argument(text: str) -> LayerSpec:
    """`parse`, as the type of an argument of argparse: the error keeps its words."""
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
        raise ValueError("disparities are finite, not negative, and descend")
    return found


def _after_slash(planes: int | None) -> str:
    return "" if planes is None else f"/{planes}"
