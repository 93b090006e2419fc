"""Guided layers: two searches for the disparity of least matching cost give each pixel its own
range of disparities, which the layers divide. No network is needed.

At 1/4 resolution: sweep the views through planes a cell of parallax apart, take the variance of
their colours over a window, aggregate it along rows and columns (semi-global matching,
Hirschmueller, 2008) and keep the cheapest plane, refined between planes by a parabola. The largest
and smallest disparity of the neighbourhood, half a plane step wider, are the range searched at 1/2
resolution: the same without aggregation, over a few layers that divide the range of each cell. The
extremes of what this finds are the final range. Known in stereo as adaptive thin volumes (Cheng et
al., UCS-Net, 2020).
"""

import math
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from .layers import CELL, upsample_maps, warp_maps
from .liveview import Camera, padded_size, uniform_disparities
from .views import widest_parallax

UNSEEN_COST = 1.0  # where fewer than two views see the layer: above any variance of colours in [0, 1]


def shrink(image: Tensor, cell: int) -> Tensor:
    """[3, H, W] -> [3, ceil(H/cell), ceil(W/cell)], area average; border cells average the pixels
    they have."""
    return F.avg_pool2d(image[None], cell, ceil_mode=True, count_include_pad=False)[0]


def box(x: Tensor, size: int) -> Tensor:
    """Mean over a size x size window inside the image, [..., h, w]."""
    return F.avg_pool2d(x, size, 1, size // 2, count_include_pad=False)


def layer_costs(views: list[Tensor], cameras: list[Camera], target: Camera, maps: Tensor, cell: int, window: int):
    """Variance of the views' colours on layers `maps` [D, h, w], averaged over a window of cells:
    [D, h, w].

    Cells are `cell` target pixels wide; the views are shrunk by the same factor."""
    warped = [warp_maps(shrink(v, cell), c, target, maps, cell) for v, c in zip(views, cameras, strict=True)]
    colour, coverage = (torch.stack(x, 1) for x in zip(*warped, strict=True))
    return window_variance(colour, coverage, window, UNSEEN_COST)


def window_variance(colour: Tensor, coverage: Tensor, window: int, unseen: float) -> Tensor:
    """Variance [D, h, w] of the colours [D, V, 3, h, w] of the views that cover more than half of a
    cell, averaged over the cells of a window that two views cover; `unseen` if there are none."""
    coverage = coverage[:, :, None]
    seen = (coverage > 0.5).to(colour.dtype)
    colour = colour / torch.where(seen > 0, coverage, torch.ones_like(coverage)) * seen
    count = seen.sum(1)
    mean = colour.sum(1) / count.clamp(min=1)
    variance = (((colour - mean[:, None]) ** 2) * seen).sum(1).sum(1, keepdim=True) / (3 * (count - 1).clamp(min=1))
    two = (count >= 2).to(colour.dtype)
    weight = box(two, window)
    cost = box(variance * two, window) / torch.where(weight > 0, weight, torch.ones_like(weight))
    return torch.where(weight > 0, cost, torch.full_like(cost, unseen))[:, 0]


# Penalties of a move to the next plane and to any other, in units of the cost (a variance of
# colours in [0, 1]), in the guided search.
STEP_PENALTY = 0.004
JUMP_PENALTY = 0.1


def semi_global(costs: Tensor, step: float = STEP_PENALTY, jump: float = JUMP_PENALTY) -> Tensor:
    """Aggregated costs [D, h, w] -> [D, h, w]: the sum over four directions (down, up, right, left)
    of the cheapest path that ends in each cell and plane."""
    columns = costs.transpose(1, 2)
    vertical = scan(costs, step, jump) + scan(costs.flip(1), step, jump).flip(1)
    horizontal = scan(columns, step, jump) + scan(columns.flip(1), step, jump).flip(1)
    return vertical + horizontal.transpose(1, 2)


def scan(costs: Tensor, step: float, jump: float) -> Tensor:
    """One direction, along dimension 1: the cost here, plus the cheapest of staying on the plane,
    stepping to the next and jumping to any other, less the cheapest before (which keeps the sums
    small and changes no comparison)."""
    before = costs[:, 0]
    total = [before]
    edge = torch.full_like(before[:1], torch.inf)
    for cost in costs.unbind(1)[1:]:
        best = before.amin(0)
        beside = torch.minimum(torch.cat([before[1:], edge]), torch.cat([edge, before[:-1]])) + step
        before = cost + (torch.minimum(torch.minimum(before, beside), best + jump) - best)
        total.append(before)
    return torch.stack(total, 1)


def winner_takes_all(costs: Tensor, maps: Tensor) -> Tensor:
    """Disparity [h, w] of the cheapest of the layers [D, h, w], moved to the vertex of the parabola
    through its cost and its neighbours' (ties: the nearer layer; the first and the last layer are
    not moved)."""
    index = costs.argmin(0, keepdim=True)
    before, after = (index - 1).clamp(min=0), (index + 1).clamp(max=len(costs) - 1)
    nearer, here, farther = (costs.gather(0, i)[0] for i in (before, index, after))
    curvature = nearer - 2 * here + farther
    inner = ((before < index) & (index < after))[0] & (curvature > 0)
    move = torch.where(inner, 0.5 * (nearer - farther) / torch.where(inner, curvature, 1.0), 0.0)
    towards = maps.gather(0, torch.where(move > 0, after[0], before[0])[None])[0]
    own = maps.gather(0, index)[0]
    return own + move.abs() * (towards - own)


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


COARSE_CELL = 4  # target pixels per cell of the first search
LEAST_PLANES, MOST_PLANES = 8, 128  # of the first search
FINE_LAYERS = 6  # of the second search
WINDOWS = 3, 7  # cells over which the variance is averaged in each search


def search_planes(cameras: list[Camera], target: Camera, near: float, far: float, planes: int | None = None) -> Tensor:
    """Disparities of the first search, [D] float64: `planes` of them, or as many as lie a cell of
    parallax apart."""
    parallax = widest_parallax(cameras, target, near, far, padded_size(target.height, target.width))
    count = math.ceil(min(parallax / COARSE_CELL, MOST_PLANES))
    return uniform_disparities(near, far, planes or max(count, LEAST_PLANES))


def fine_layers(found: RangeMap) -> Tensor:
    """The layers of the second search, which divide the range that the first found:
    [FINE_LAYERS, h, w], cells of CELL pixels."""
    return upsample_maps(guided_maps(*found, FINE_LAYERS), COARSE_CELL // CELL)


def guided_search(
    views: list[Tensor], cameras: list[Camera], target: Camera, near: float, far: float, planes: int | None = None
) -> RangeMap:
    """The range of each cell of CELL x CELL pixels of the padded target; `planes` as search_planes
    takes it."""
    disparities = search_planes(cameras, target, near, far, planes).to(views[0].dtype)
    height, width = (side // COARSE_CELL for side in padded_size(target.height, target.width))
    maps = disparities[:, None, None].expand(-1, height, width)
    costs = semi_global(layer_costs(views, cameras, target, maps, COARSE_CELL, WINDOWS[0]))
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
    """`count` guided layers as full-resolution disparity maps [L, H8, W8] over the padded target,
    near -> far."""
    return upsample_maps(guided_maps(*guided_search(views, cameras, target, near, far, planes), count))
