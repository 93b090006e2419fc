"""Matching cost of layers on a coarse grid: the variance of the views' warped colours.

The guided search minimises it; no network is needed.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from liveview_ref.reference.geometry.camera import Camera
from liveview_ref.reference.warp import warp_maps

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
