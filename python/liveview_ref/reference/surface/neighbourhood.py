"""Holes of a map, filled from their neighbourhood."""

import torch
import torch.nn.functional as F
from torch import Tensor


def fill_holes(map_: Tensor) -> Tensor:
    """Holes (pixels below 0) take the smallest disparity among their 8 neighbours that have one,
    one ring of pixels at a time, until none is left. A map of holes alone becomes 0."""
    if not bool((map_ >= 0).any()):
        return torch.zeros_like(map_)
    while bool((map_ < 0).any()):
        known = torch.where(map_ >= 0, map_, torch.inf)
        least = -F.max_pool2d(-known[None], 3, 1, 1)[0]
        map_ = torch.where((map_ < 0) & (least < torch.inf), least, map_)
    return map_
