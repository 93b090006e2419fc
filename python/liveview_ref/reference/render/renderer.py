"""The whole pipeline, one batch of layers at a time: views, target and layers -> target image."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..composite import Composited, composite
from ..geometry.camera import Camera
from ..geometry.view_selection import view_distances
from ..warp import warp_maps
from .blend import blend

Network = Callable[[Tensor], Tensor]  # hwv [n, 3V, H8, W8] -> logits [n, V, H8, W8]


@dataclass
class Intermediates:
    """The intermediates of a render over the padded target, for parity: colour [L, V, 3, H, W],
    coverage [L, V, H, W], logits [L, V, H, W], alpha [L, H, W], rgb [L, 3, H, W]."""

    colour: Tensor
    coverage: Tensor
    logits: Tensor
    alpha: Tensor
    rgb: Tensor


def warp_views(views: list[Tensor], cameras: list[Camera], target: Camera, maps: Tensor) -> tuple[Tensor, Tensor]:
    """Views warped by all layers: colour [L, V, 3, H, W], coverage [L, V, H, W]."""
    warped = [warp_maps(v, c, target, maps) for v, c in zip(views, cameras, strict=True)]
    return torch.stack([rgb for rgb, _ in warped], 1), torch.stack([coverage for _, coverage in warped], 1)


def render(
    network: Network,
    views: list[Tensor],
    cameras: list[Camera],
    target: Camera,
    maps: Tensor,
    batch: int = 8,
) -> tuple[Composited, Intermediates]:
    """views: V images [3, Hs, Ws] in order of distance, nearest first; maps [L, H8, W8] near ->
    far. The result is cropped to the target's size; the intermediates are not."""
    distances = view_distances(cameras, target)
    parts = []
    for part in maps.split(batch):
        colour, coverage = warp_views(views, cameras, target, part)
        logits = network(colour.flatten(1, 2))
        parts.append((colour, coverage, logits, *blend(logits, colour, coverage, distances)))
    stages = Intermediates(*(torch.cat(x) for x in zip(*parts, strict=True)))
    covered = (stages.coverage[-1] > 0).any(0)
    full = composite(stages.alpha, stages.rgb, covered, maps)
    crop = (..., slice(target.height), slice(target.width))
    return Composited(full.rgb[crop], full.disparity[crop], full.transmittance[crop], full.weights[crop]), stages
