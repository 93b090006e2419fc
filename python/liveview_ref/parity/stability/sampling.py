"""Extreme sampling: tiny photos, samples exactly on edges and far outside, magnification and
minification. The target's pixel x is at `scale` x + `shift` in the source."""

import numpy as np
import torch

from ...reference.liveview import Camera
from .case import Case, decades, exponent, units
from .warp import BOUND, Warp

PHOTO_SIZE = 37, 23  # except in the family of sizes: odd, and not a multiple of any block size
EXACT_BOUND = 1.2e-7  # at whole and half pixels: samples are pixels or means of two, rounded once or twice

Pair = tuple[float, float]


def photo(width: int, height: int) -> np.ndarray:
    return units(width * 1000 + height, height, width, 3).transpose(2, 0, 1).copy()


def camera(size: tuple[int, int], scale: float, shift: Pair) -> Camera:
    """At the origin."""
    k = torch.tensor([[scale, 0, shift[0]], [0, scale, shift[1]], [0, 0, 1]], dtype=torch.float64)
    return Camera(k, torch.eye(3, dtype=torch.float64), torch.zeros(3, dtype=torch.float64), *size)


def sampled(scale: float, shift: Pair, size=PHOTO_SIZE, target_size=PHOTO_SIZE) -> Warp:
    beside = scale == 1 and any(abs(by) >= side for by, side in zip(shift, size, strict=True))
    cameras = camera(size, scale, shift), camera(target_size, 1, (0, 0))
    return Warp(photo(*size), *cameras, disparity=0, must_cover=not beside)


def families() -> list[list[Case]]:
    width, height = PHOTO_SIZE
    sizes = (1, 1), (1, 9), (9, 1), (2, 2), (3, 5), (17, 1), (65, 63), (129, 7)
    shifts = [
        shift
        for by in (0.0, 0.5, 1.0)
        for shift in ((by, 0.0), (-by, by), (width - by, 0.0), (by - width, 0.0), (0.0, by - height))
    ]
    outside = decades(*range(10), 15, 30, 50, 75)

    def scaled(family: str, scale: float) -> Case:
        middle = width / 2 * (1 - scale) + 0.3, height / 2 * (1 - scale) - 0.2
        return Case(family, f"scale {exponent(scale)}", sampled(scale, middle), BOUND)

    return [
        [Case("photo size", f"{w}x{h}", sampled(1, (-0.75, -1.25), (w, h), (w + 2, h + 3)), BOUND) for w, h in sizes],
        [Case("exact hits of edges", f"shift {x:g}, {y:g}", sampled(1, (x, y)), EXACT_BOUND) for x, y in shifts],
        [Case("far outside", f"shift {exponent(by)}", sampled(1, (by, -by)), BOUND) for by in outside],
        [scaled("magnification", 1 / by) for by in decades(*range(7))],
        [scaled("minification", by) for by in decades(*range(7))],
    ]
