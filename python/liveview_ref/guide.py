"""Guided layers: a coarse search gives each pixel its own range of disparities (design section 2).

At 1/4 resolution: sweep the views through planes a cell of parallax apart, take the variance of their colours over a
window, make it agree along rows and columns (semiglobal), keep the cheapest plane, refined between planes by a
parabola. The neighbourhood's largest and smallest disparity, half a plane step wider, are what is searched at 1/2
resolution: the same over a few layers that divide that range, each cell for itself. The extremes of what this finds are
the range. Known in stereo as adaptive thin volumes (UCS-Net, 2020).
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor

from .camera import Camera
from .cost import layer_costs
from .layers import CELL, guided_maps, padded_size, uniform_planes, upsample_maps
from .semiglobal import semi_global
from .sweep import sweep_terms

COARSE = 4  # target pixels per cell of the first search
FEWEST, MOST = 8, 128  # planes of the first search
FINE = 6  # layers of the second
WINDOWS = 3, 7  # cells over which the variance is averaged in each


def parallax(cameras: list[Camera], target: Camera, near: float, far: float) -> float:
    """Pixels between near and far in the view that sees most of it: the median over the target's corners and centre."""
    x, y = torch.tensor([[0, 1, 0, 1, 0.5], [0, 0, 1, 1, 0.5]], dtype=torch.float64)
    height, width = padded_size(target.height, target.width)
    pixels = torch.stack([x * width, y * height, torch.ones_like(x)])
    largest = 0.0
    for camera in cameras:
        homography, e = sweep_terms(camera, target)
        a, b = (homography @ pixels + (e * disparity)[:, None] for disparity in (1 / near, 1 / far))
        apart = (a[:2] / a[2] - b[:2] / b[2]).norm(dim=0)[(a[2] > 0) & (b[2] > 0)]
        largest = max(largest, float(apart.median()) if len(apart) else 0.0)
    return largest


def search_planes(cameras: list[Camera], target: Camera, near: float, far: float) -> Tensor:
    """Disparities of the first search, a cell of parallax apart, [D] float64."""
    count = math.ceil(min(parallax(cameras, target, near, far) / COARSE, MOST))
    return uniform_planes(near, far, max(count, FEWEST))


def winner(costs: Tensor, maps: Tensor) -> Tensor:
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
    """3x3 median of [h, w], edges held."""
    padded = F.pad(x[None, None], (1, 1, 1, 1), mode="replicate")
    return F.unfold(padded, 3).reshape(9, *x.shape).median(0).values


def range_of(disparity: Tensor, margin: float = 0.0) -> tuple[Tensor, Tensor, Tensor]:
    """Disparity found [h, w] -> (nearest, surface, farthest) [h, w]: the surface is median-filtered; the extremes of
    its neighbourhood, a margin (disparity) wider and smoothed, are the range."""
    surface = median3(disparity)
    disparity = surface[None, None]
    nearest = F.max_pool2d(disparity, 3, 1, 1) + margin
    farthest = -F.max_pool2d(-disparity, 3, 1, 1) - margin
    padded = (F.pad(x, (1, 1, 1, 1), mode="replicate") for x in (nearest, farthest.clamp(min=0)))
    nearest, farthest = (F.avg_pool2d(x, 3, 1)[0, 0] for x in padded)
    return nearest, surface, farthest


def fine_layers(*ranges: Tensor) -> Tensor:
    """The layers of the second search: the first one's ranges divided, [FINE, h, w] on cells of CELL pixels."""
    return upsample_maps(guided_maps(*ranges, FINE), COARSE // CELL)


def coarse_range(views: list[Tensor], cameras: list[Camera], target: Camera, near: float, far: float):
    """(nearest, surface, farthest) disparity [h, w] per cell of CELL x CELL pixels of the padded target."""
    disparities = search_planes(cameras, target, near, far).to(views[0].dtype)
    height, width = (side // COARSE for side in padded_size(target.height, target.width))
    maps = disparities[:, None, None].expand(-1, height, width)
    costs = semi_global(layer_costs(views, cameras, target, maps, COARSE, WINDOWS[0]))
    layers = fine_layers(*range_of(winner(costs, maps), float(disparities[0] - disparities[1]) / 2))
    costs = layer_costs(views, cameras, target, layers, CELL, WINDOWS[1])
    return range_of(winner(costs, layers))


def guided_layers(views, cameras, target: Camera, near: float, far: float, count: int) -> Tensor:
    """`count` guided layers as full-resolution disparity maps [L, H8, W8] over the padded target, near -> far."""
    return upsample_maps(guided_maps(*coarse_range(views, cameras, target, near, far), count))
