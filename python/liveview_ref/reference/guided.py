"""Guided layers: a coarse-to-fine search gives each pixel its own range of disparities, which the layers divide.

At 1/4 resolution: sweep the views through planes a cell of parallax apart, take the variance of their colours over a
window, aggregate it along rows and columns (semi_global), keep the cheapest plane, refined between planes by a
parabola. The neighbourhood's largest and smallest disparity, half a plane step wider, are the range that is searched at
1/2 resolution: the same, without aggregation, over a few layers that divide the range of each cell. The extremes of
what this finds are the final range. Known in stereo as adaptive thin volumes (Cheng et al., UCS-Net, 2020).
"""

import math
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from .camera import Camera
from .layers import CELL, guided_maps, padded_size, uniform_disparities, upsample_maps
from .matching_cost import layer_costs
from .plane_sweep import PlaneSweep
from .semi_global import semi_global

COARSE = 4  # target pixels per cell of the first search
FEWEST, MOST = 8, 128  # planes of the first search
FINE = 6  # layers of the second
WINDOWS = 3, 7  # cells over which the variance is averaged in each


class RangeMap(NamedTuple):
    """Of each cell, the disparities [h, w] between which the scene lies, and where its surface is."""

    nearest: Tensor
    surface: Tensor
    farthest: Tensor


def parallax(
    cameras: list[Camera], target: Camera, near: float, far: float, size: tuple[int, int] | None = None
) -> float:
    """Pixels between near and far in the view that sees most of it: the median over the corners and the centre of the
    target, padded unless its size (height, width) is given."""
    return float(parallax_between(cameras, target, torch.tensor([1 / near, 1 / far], dtype=torch.float64), size))


def parallax_between(
    cameras: list[Camera], target: Camera, disparities: Tensor, size: tuple[int, int] | None = None
) -> Tensor:
    """As `parallax`, from each of these disparities [L] to the next, where both lie in front of the view: [L - 1]
    float64."""
    x, y = torch.tensor([[0, 1, 0, 1, 0.5], [0, 0, 1, 1, 0.5]], dtype=torch.float64)
    height, width = size or padded_size(target.height, target.width)
    pixels = torch.stack([x * width, y * height, torch.ones_like(x)])
    largest = torch.zeros(len(disparities) - 1, dtype=torch.float64)
    for camera in cameras:
        homography, epipole = PlaneSweep.of(camera, target)
        at = homography @ pixels + epipole[:, None] * disparities.double()[:, None, None]  # [L, 3, 5]
        positions = (at[:, :2] / at[:, 2:]).masked_fill(at[:, 2:] <= 0, torch.nan)
        apart = positions.diff(dim=0).norm(dim=1).nanmedian(dim=1).values
        largest = torch.maximum(largest, apart.nan_to_num(nan=0.0))
    return largest


def search_planes(cameras: list[Camera], target: Camera, near: float, far: float, planes: int | None = None) -> Tensor:
    """Disparities of the first search, [D] float64: `planes` of them, or as many as lie a cell of parallax apart."""
    count = math.ceil(min(parallax(cameras, target, near, far) / COARSE, MOST))
    return uniform_disparities(near, far, planes or max(count, FEWEST))


def winner_takes_all(costs: Tensor, maps: Tensor) -> Tensor:
    """Disparity [h, w] of the cheapest of the layers [D, h, w], moved to the vertex of a parabola through its cost and
    its neighbours' (ties: the nearer layer; none at the first and last layer)."""
    index = costs.argmin(0, keepdim=True)
    before, after = (index - 1).clamp(min=0), (index + 1).clamp(max=len(costs) - 1)
    nearer, here, farther = (costs.gather(0, i)[0] for i in (before, index, after))
    curvature = nearer - 2 * here + farther
    inner = ((before < index) & (index < after))[0] & (curvature > 0)
    move = torch.where(inner, 0.5 * (nearer - farther) / torch.where(inner, curvature, 1.0), 0.0)
    towards = maps.gather(0, torch.where(move > 0, after[0], before[0])[None])[0]
    own = maps.gather(0, index)[0]
    return own + move.abs() * (towards - own)


def median3(x: Tensor) -> Tensor:
    """3x3 median of [h, w], edges repeated."""
    padded = F.pad(x[None, None], (1, 1, 1, 1), mode="replicate")
    return F.unfold(padded, 3).reshape(9, *x.shape).median(0).values


def range_of(disparity: Tensor, margin: float = 0.0) -> RangeMap:
    """Disparity found [h, w] -> its range: the surface is median-filtered; the extremes of its neighbourhood, wider by
    a margin (disparity) and smoothed, are nearest and farthest."""
    surface = median3(disparity)
    disparity = surface[None, None]
    nearest = F.max_pool2d(disparity, 3, 1, 1) + margin
    farthest = -F.max_pool2d(-disparity, 3, 1, 1) - margin
    padded = (F.pad(x, (1, 1, 1, 1), mode="replicate") for x in (nearest, farthest.clamp(min=0)))
    nearest, farthest = (F.avg_pool2d(x, 3, 1)[0, 0] for x in padded)
    return RangeMap(nearest, surface, farthest)


def fine_layers(found: RangeMap) -> Tensor:
    """The layers of the second search, which divide the range that the first found: [FINE, h, w], cells of CELL
    pixels."""
    return upsample_maps(guided_maps(*found, FINE), COARSE // CELL)


def guided_search(
    views: list[Tensor], cameras: list[Camera], target: Camera, near: float, far: float, planes: int | None = None
) -> RangeMap:
    """The range of each cell of CELL x CELL pixels of the padded target; `planes` as search_planes takes it."""
    disparities = search_planes(cameras, target, near, far, planes).to(views[0].dtype)
    height, width = (side // COARSE for side in padded_size(target.height, target.width))
    maps = disparities[:, None, None].expand(-1, height, width)
    costs = semi_global(layer_costs(views, cameras, target, maps, COARSE, WINDOWS[0]))
    step = float(disparities[0] - disparities[1])
    layers = fine_layers(range_of(winner_takes_all(costs, maps), step / 2))
    costs = layer_costs(views, cameras, target, layers, CELL, WINDOWS[1])
    return range_of(winner_takes_all(costs, layers))


def guided_layers(
    views: list[Tensor],
    cameras: list[Camera],
    target: Camera,
    near: float,
    far: float,
    count: int,
    planes: int | None = None,
) -> Tensor:
    """`count` guided layers as full-resolution disparity maps [L, H8, W8] over the padded target, near -> far."""
    return upsample_maps(guided_maps(*guided_search(views, cameras, target, near, far, planes), count))
