"""Depths of photos carried to the target: each pixel as a square of 0.4 pixels' side, nearest wins.

A point lies in the pixels that hold its four corners (+-0.2 pixel); of each photo's points each pixel keeps the largest
disparity. Over the photos: the largest that another photo has within `agree` of it, or the largest of all if there is
no such pair; then the mean, in their order, of those at most `fuse` behind that and not above it.
"""

from collections.abc import Iterator
from itertools import combinations

import torch
from torch import Tensor

from ..camera import Camera
from .project import projected

HALF = 0.2  # half a side of a point's square, in pixels


def splat(
    maps: list[tuple[Camera, Tensor]], target: Camera, height: int, width: int, agree: float, fuse: float
) -> Tensor:
    """Disparity [height, width] of the padded target from known depths; -1 where nothing falls."""
    each = [splat_one(camera, known, target, height, width) for camera, known in maps]
    nearest = first_surface(each, agree)
    total, number = torch.zeros_like(nearest), torch.zeros_like(nearest)
    for one in each:
        counts = (one >= 0) & (one <= nearest) & (nearest - one <= fuse)
        total, number = total + torch.where(counts, one, 0), number + counts
    return torch.where(number > 0, total / number.clamp(min=1), nearest)


def first_surface(each: list[Tensor], agree: float) -> Tensor:
    """The nearer of the nearest two that lie within `agree` of each other, or the nearest of all."""
    paired = torch.full_like(each[0], -1)
    for one, other in combinations(each, 2):
        near, far = torch.maximum(one, other), torch.minimum(one, other)
        paired = torch.where((far >= 0) & (near - far <= agree), torch.maximum(paired, near), paired)
    return torch.where(paired >= 0, paired, torch.stack(each).amax(0))


def splat_one(camera: Camera, known: Tensor, target: Camera, height: int, width: int) -> Tensor:
    """The largest disparity of a photo's points in each pixel."""
    nearest = torch.full((height * width,), -1, dtype=known.dtype)
    for at, disparity in points(camera, known, target, height, width):
        nearest.scatter_reduce_(0, at, disparity, "amax")
    return nearest.reshape(height, width)


def points(camera: Camera, known: Tensor, target: Camera, height: int, width: int) -> Iterator[tuple[Tensor, Tensor]]:
    """Pixels that points fall into and the points' disparities: a corner at a time."""
    x, y, disparity = projected(target, camera, known)
    use = (known >= 0) & (x >= -HALF) & (y >= -HALF) & (x < width + HALF) & (y < height + HALF)
    x, y, disparity = x[use], y[use], disparity[use]
    for row in ((y - HALF).floor().long(), (y + HALF).floor().long()):
        for column in ((x - HALF).floor().long(), (x + HALF).floor().long()):
            inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
            yield (row * width + column)[inside], disparity[inside]
