"""Guided layers: a coarse plane sweep gives each pixel its own range of disparities (design section 2).

At 1/4 resolution: warp the views by `planes` uniform planes, take the variance of their colours over a window, keep the
plane of the lowest (winner takes all), median-filter, and widen to the neighbourhood's largest and smallest disparity
plus one plane step. Known in stereo as adaptive thin volumes (UCS-Net, 2020).
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from .camera import Camera
from .layers import COARSE, guided_maps, padded_size, uniform_planes, upsample_maps
from .warp import warp_maps

PLANES = 32
WINDOW = 5  # cells; the variance is averaged over WINDOW x WINDOW (5 beat 3 by 0.4 dB on the dev scenes, mean)
UNSEEN = 1.0  # cost where fewer than two views look: above any variance of colours in [0, 1]


def shrink(image: Tensor) -> Tensor:
    """[3, H, W] -> [3, ceil(H/4), ceil(W/4)], area average; border cells average the pixels they have."""
    return F.avg_pool2d(image[None], COARSE, ceil_mode=True, count_include_pad=False)[0]


def box(x: Tensor, size: int) -> Tensor:
    """Mean over a size x size window inside the image, [..., h, w]."""
    return F.avg_pool2d(x, size, 1, size // 2, count_include_pad=False)


def plane_costs(views: list[Tensor], cameras: list[Camera], target: Camera, disparities: Tensor) -> Tensor:
    """Windowed variance of the warped views [D, h, w] on the coarse grid of the padded target."""
    dtype = views[0].dtype
    height, width = (side // COARSE for side in padded_size(target.height, target.width))
    maps = disparities.to(dtype)[:, None, None].expand(-1, height, width)
    warped = [warp_maps(shrink(v), c, target, maps, COARSE) for v, c in zip(views, cameras, strict=True)]
    colour = torch.stack([rgb for rgb, _ in warped], 1)  # [D, V, 3, h, w]
    seen = torch.stack([coverage > 0.5 for _, coverage in warped], 1).to(dtype)[:, :, None]  # [D, V, 1, h, w]
    coverage = torch.stack([c for _, c in warped], 1)[:, :, None]
    colour = colour / torch.where(seen > 0, coverage, torch.ones_like(coverage)) * seen
    count = seen.sum(1)
    mean = colour.sum(1) / count.clamp(min=1)
    variance = (((colour - mean[:, None]) ** 2) * seen).sum(1).sum(1, keepdim=True) / (3 * (count - 1).clamp(min=1))
    two = (count >= 2).to(dtype)
    weight = box(two, WINDOW)
    cost = box(variance * two, WINDOW) / torch.where(weight > 0, weight, torch.ones_like(weight))
    return torch.where(weight > 0, cost, torch.full_like(cost, UNSEEN))[:, 0]


def median3(x: Tensor) -> Tensor:
    """3x3 median of [h, w], edges held."""
    padded = F.pad(x[None, None], (1, 1, 1, 1), mode="replicate")
    return F.unfold(padded, 3).reshape(9, *x.shape).median(0).values


def range_of(winner: Tensor, step: float) -> tuple[Tensor, Tensor]:
    """Disparity of the winning plane [h, w] -> (nearest, farthest) [h, w]: the neighbourhood's extremes, one step wider
    (`step` = disparity between coarse planes), smoothed."""
    winner = median3(winner)[None, None]
    nearest = F.max_pool2d(winner, 3, 1, 1) + step
    farthest = -F.max_pool2d(-winner, 3, 1, 1) - step
    padded = (F.pad(x, (1, 1, 1, 1), mode="replicate") for x in (nearest, farthest.clamp(min=0)))
    nearest, farthest = (F.avg_pool2d(x, 3, 1)[0, 0] for x in padded)
    return nearest, farthest


def coarse_range(views: list[Tensor], cameras: list[Camera], target: Camera, near: float, far: float):
    """(nearest, farthest) disparity [h, w] per coarse cell of the padded target."""
    disparities = uniform_planes(near, far, PLANES)
    winner = plane_costs(views, cameras, target, disparities).argmin(0)
    step = float(disparities[0] - disparities[1])
    return range_of(disparities.to(views[0].dtype)[winner], step)


def guided_layers(views, cameras, target: Camera, near: float, far: float, count: int) -> Tensor:
    """`count` guided layers as full-resolution disparity maps [L, H8, W8] over the padded target, near -> far."""
    return upsample_maps(guided_maps(*coarse_range(views, cameras, target, near, far), count))
