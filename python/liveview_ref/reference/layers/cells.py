"""The padded target, and maps on a coarse grid of cells over it."""

import torch.nn.functional as F
from torch import Tensor

STRIDE = 8  # the network halves its input three times
CELL = 2  # target pixels per cell of a map


def padded_size(height: int, width: int) -> tuple[int, int]:
    """Height and width rounded up to a multiple of the network's stride."""
    return -(-height // STRIDE) * STRIDE, -(-width // STRIDE) * STRIDE


def upsample_maps(coarse: Tensor, factor: int = CELL) -> Tensor:
    """Maps [L, h, w] -> [L, factor h, factor w], bilinear between cell centres, edges repeated."""
    return F.interpolate(coarse[None], scale_factor=factor, mode="bilinear", align_corners=False)[0]
