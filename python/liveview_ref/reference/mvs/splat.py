"""Depths of photos carried to the target: each pixel as a square of half a pixel's side, nearest wins.

A point lies in the pixels that hold its four corners (+-0.25 pixel), in each of them once. A pixel has the mean of
those of its points that lie less than `fuse` behind its nearest.
"""

from collections.abc import Iterator

import torch
from torch import Tensor

from ..camera import Camera
from .project import projected

HALF = 0.25  # half a side of a point's square, in pixels


def splat(maps: list[tuple[Camera, Tensor]], target: Camera, height: int, width: int, fuse: float) -> Tensor:
    """Disparity [height, width] of the padded target from known depths; -1 where nothing falls."""
    dtype = maps[0][1].dtype
    nearest = torch.full((height * width,), -1, dtype=dtype)
    for camera, known in maps:
        for at, disparity in points(camera, known, target, height, width):
            nearest.scatter_reduce_(0, at, disparity, "amax")
    if fuse == 0:
        return nearest.reshape(height, width)
    total, number = torch.zeros_like(nearest), torch.zeros_like(nearest)
    for camera, known in maps:
        parts = list(points(camera, known, target, height, width))
        at, disparity = torch.cat([p[0] for p in parts]), torch.cat([p[1] for p in parts])
        near = nearest[at] - disparity < fuse
        one_total, one = torch.zeros_like(total), torch.ones_like(disparity[near])
        total += one_total.index_add_(0, at[near], disparity[near])
        number.index_add_(0, at[near], one)
    return torch.where(number > 0, total / number.clamp(min=1), nearest).reshape(height, width)


def points(camera: Camera, known: Tensor, target: Camera, height: int, width: int) -> Iterator[tuple[Tensor, Tensor]]:
    """Pixels that points fall into, row by row, and the points' disparities: a corner at a time."""
    x, y, disparity = projected(target, camera, known)
    use = (known >= 0) & (x > -HALF) & (y > -HALF) & (x < 2 * width) & (y < 2 * height)
    x, y, disparity = x[use], y[use], disparity[use]
    (left, right), (top, bottom) = (((p - HALF).floor().long(), (p + HALF).floor().long()) for p in (x, y))
    for row, new_row in ((top, None), (bottom, bottom > top)):
        for column, new_column in ((left, None), (right, right > left)):
            inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
            for new in (new_row, new_column):
                inside = inside if new is None else inside & new
            yield (row * width + column)[inside], disparity[inside]
