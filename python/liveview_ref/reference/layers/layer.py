"""Planes as maps of disparity per pixel."""

import torch
from torch import Tensor

from ..geometry.camera import Camera
from .cells import padded_size


def plane_maps(target: Camera, disparities: Tensor, dtype: torch.dtype) -> Tensor:
    """Planes [D] as maps [D, H8, W8] over the padded target."""
    height, width = padded_size(target.height, target.width)
    return disparities.to(dtype)[:, None, None].expand(-1, height, width)
