"""Depths of photos projected to the target: each pixel is splatted as a square with a side of 0.4
pixels; the nearest wins.

A point covers the pixels that contain its four corners (+-0.2 pixel); of each photo's points a
pixel keeps the largest disparity. Over the photos: the largest that another photo confirms within
`agree`, or the largest of all if there is no such pair (unless `single` is false); then the mean,
in the order of the photos, of those at most `fuse` behind it and not above it.
"""

from collections.abc import Iterator
from itertools import combinations

import torch
from torch import Tensor

from liveview_ref.reference.geometry.camera import Camera

from .project import projected

HALF_SIDE = 0.2  # of a point's square, target pixels
FUSED = 3.0  # px behind the nearest within which depths are averaged


def splat(
    maps: list[tuple[Camera, Tensor]],
    target: Camera,
    height: int,
    width: int,
    agree: float,
    fuse: float,
    single: bool = True,
) -> Tensor:
    """Disparity [height, width] of the padded target from confirmed depths; -1 where
    no point falls."""
    each = [splat_one(camera, confirmed, target, height, width) for camera, confirmed in maps]
    nearest = first_surface(each, agree, single)
    total, number = torch.zeros_like(nearest), torch.zeros_like(nearest)
    for one in each:
        counts = (one >= 0) & (one <= nearest) & (nearest - one <= fuse)
        total, number = total + torch.where(counts, one, 0), number + counts
    return torch.where(number > 0, total / number.clamp(min=1), nearest)


def first_surface(each: list[Tensor], agree: float, single: bool) -> Tensor:
    """The nearest disparity that lies within `agree` of another photo's, or the nearest of all if
    `single`, else -1."""
    paired = torch.full_like(each[0], -1)
    for one, other in combinations(each, 2):
        near, far = torch.maximum(one, other), torch.minimum(one, other)
        paired = torch.where((far >= 0) & (near - far <= agree), torch.maximum(paired, near), paired)
    return torch.where(paired >= 0, paired, torch.stack(each).amax(0)) if single else paired


def splat_one(camera: Camera, confirmed: Tensor, target: Camera, height: int, width: int) -> Tensor:
    """The largest disparity of a photo's points in each pixel."""
    nearest = torch.full((height * width,), -1, dtype=confirmed.dtype)
    for at, disparity in points(camera, confirmed, target, height, width):
        nearest.scatter_reduce_(0, at, disparity, "amax")
    return nearest.reshape(height, width)


def points(
    camera: Camera, confirmed: Tensor, target: Camera, height: int, width: int
) -> Iterator[tuple[Tensor, Tensor]]:
    """Pixels that the points' corners fall into, and the points' disparities, one corner at a
    time."""
    x, y, disparity = projected(target, camera, confirmed)
    use = (confirmed >= 0) & (x >= -HALF_SIDE) & (y >= -HALF_SIDE) & (x < width + HALF_SIDE) & (y < height + HALF_SIDE)
    x, y, disparity = x[use], y[use], disparity[use]
    for row in ((y - HALF_SIDE).floor().long(), (y + HALF_SIDE).floor().long()):
        for column in ((x - HALF_SIDE).floor().long(), (x + HALF_SIDE).floor().long()):
            inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
            yield (row * width + column)[inside], disparity[inside]
