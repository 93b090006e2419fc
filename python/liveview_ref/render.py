"""The whole pipeline: views, target and layers -> target image (design section 1), one batch of layers at a time."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from .blend import blend
from .camera import Camera
from .composite import Composited, composite
from .layers import padded_size
from .warp import warp_maps


@dataclass
class Stages:
    """Every intermediate of a render, over the padded target, for parity: colour [L, V, 3, H, W],
    coverage [L, V, H, W], logits [L, V, H, W], alpha [L, H, W], rgb [L, 3, H, W]."""

    colour: Tensor
    coverage: Tensor
    logits: Tensor
    alpha: Tensor
    rgb: Tensor


def view_distances(cameras: list[Camera], target: Camera) -> Tensor:
    """Distance of each view's centre to the target's, scene units, [V] float64."""
    return torch.stack([(c.centre - target.centre).norm() for c in cameras])


def warp_views(views: list[Tensor], cameras: list[Camera], target: Camera, maps: Tensor) -> tuple[Tensor, Tensor]:
    """Views warped by all layers: colour [L, V, 3, H, W], coverage [L, V, H, W]."""
    warped = [warp_maps(v, c, target, maps) for v, c in zip(views, cameras, strict=True)]
    return torch.stack([rgb for rgb, _ in warped], 1), torch.stack([coverage for _, coverage in warped], 1)


def render(
    network: Callable[[Tensor], Tensor],
    views: list[Tensor],
    cameras: list[Camera],
    target: Camera,
    maps: Tensor,
    batch: int = 8,
) -> tuple[Composited, Stages]:
    """views: V images [3, Hs, Ws] in order of distance, nearest first; maps [L, H8, W8] near -> far.
    `network` maps an HWV [n, 3V, H8, W8] to logits [n, V, H8, W8]. The result is cropped to the target's size."""
    distances = view_distances(cameras, target)
    stages = []
    for part in maps.split(batch):
        colour, coverage = warp_views(views, cameras, target, part)
        logits = network(colour.flatten(1, 2))
        stages.append((colour, coverage, logits, *blend(logits, colour, coverage, distances)))
    stages = Stages(*(torch.cat(x) for x in zip(*stages, strict=True)))
    covered = (stages.coverage[-1] > 0).any(0)
    full = composite(stages.alpha, stages.rgb, covered, maps)
    crop = (..., slice(target.height), slice(target.width))
    return Composited(full.rgb[crop], full.disparity[crop], full.transmittance[crop], full.weights[crop]), stages


def planes_over(target: Camera, disparities: Tensor, dtype: torch.dtype) -> Tensor:
    """Planes [D] as maps [D, H8, W8] over the padded target."""
    height, width = padded_size(target.height, target.width)
    return disparities.to(dtype)[:, None, None].expand(-1, height, width)
