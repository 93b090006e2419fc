"""Layers: disparity per pixel, near -> far. A plane is a constant; a guided layer is a smooth map on a coarse grid."""

import torch
import torch.nn.functional as F
from torch import Tensor

from .camera import Camera

STRIDE = 8  # the network halves its input three times
CELL = 2  # target pixels per cell of a map


def padded_size(height: int, width: int) -> tuple[int, int]:
    """Height and width rounded up to a multiple of the network's stride."""
    return -(-height // STRIDE) * STRIDE, -(-width // STRIDE) * STRIDE


def uniform_disparities(near: float, far: float, count: int) -> Tensor:
    """`count` disparities, evenly spaced in 1/z from 1/near to 1/far, near -> far, [D] float64. `far` may be inf."""
    if count == 1:
        return torch.tensor([0.5 / near + 0.5 / far], dtype=torch.float64)
    step = torch.arange(count, dtype=torch.float64) / (count - 1)
    return 1.0 / near + step * (1.0 / far - 1.0 / near)


def plane_maps(target: Camera, disparities: Tensor, dtype: torch.dtype) -> Tensor:
    """Planes [D] as maps [D, H8, W8] over the padded target."""
    height, width = padded_size(target.height, target.width)
    return disparities.to(dtype)[:, None, None].expand(-1, height, width)


def guided_maps(nearest: Tensor, surface: Tensor, farthest: Tensor, count: int) -> Tensor:
    """Divide the range (disparities [h, w] each) of each cell evenly: maps [L, h, w], near -> far. One map alone
    follows the surface."""
    if count == 1:
        return surface[None]
    step = torch.arange(count, dtype=nearest.dtype)[:, None, None] / (count - 1)
    return nearest + step * (farthest - nearest)


def upsample_maps(coarse: Tensor, factor: int = CELL) -> Tensor:
    """Maps [L, h, w] -> [L, factor h, factor w], bilinear between cell centres, edges repeated."""
    return F.interpolate(coarse[None], scale_factor=factor, mode="bilinear", align_corners=False)[0]
