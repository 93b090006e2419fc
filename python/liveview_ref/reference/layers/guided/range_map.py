"""The range of disparities of each cell, and the layers that divide it."""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor


class RangeMap(NamedTuple):
    """Per cell, the disparities [h, w] between which the scene lies, and the disparity
    of its surface."""

    nearest: Tensor
    surface: Tensor
    farthest: Tensor


def range_of(disparity: Tensor, margin: float = 0.0) -> RangeMap:
    """Range of each cell from the disparity found there [h, w]: the surface is its 3x3 median;
    nearest and farthest are the extremes of the surface's 3x3 neighbourhood, widened by a margin
    (disparity) and smoothed."""
    surface = median3(disparity)
    disparity = surface[None, None]
    nearest = F.max_pool2d(disparity, 3, 1, 1) + margin
    farthest = -F.max_pool2d(-disparity, 3, 1, 1) - margin
    padded = (F.pad(x, (1, 1, 1, 1), mode="replicate") for x in (nearest, farthest.clamp(min=0)))
    nearest, farthest = (F.avg_pool2d(x, 3, 1)[0, 0] for x in padded)
    return RangeMap(nearest, surface, farthest)


def guided_maps(nearest: Tensor, surface: Tensor, farthest: Tensor, count: int) -> Tensor:
    """`count` maps [L, h, w], near -> far, that divide the range of each cell (disparities [h, w])
    evenly. A single map follows the surface."""
    if count == 1:
        return surface[None]
    step = torch.arange(count, dtype=nearest.dtype)[:, None, None] / (count - 1)
    return nearest + step * (farthest - nearest)


def median3(x: Tensor) -> Tensor:
    """3x3 median of [h, w], edges repeated."""
    padded = F.pad(x[None, None], (1, 1, 1, 1), mode="replicate")
    return F.unfold(padded, 3).reshape(9, *x.shape).median(0).values
