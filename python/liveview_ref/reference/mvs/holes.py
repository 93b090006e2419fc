"""Holes of a map: they take the farthest of their neighbours, ring by ring."""

import torch
import torch.nn.functional as F
from torch import Tensor


def grown(map_: Tensor) -> Tensor:
    """Pixels below 0 become the least of their 8 neighbours that are known, all of a ring at once, and so on; a map
    that knows nothing becomes 0."""
    if not bool((map_ >= 0).any()):
        return torch.zeros_like(map_)
    while bool((map_ < 0).any()):
        known = torch.where(map_ >= 0, map_, torch.inf)
        least = -F.max_pool2d(-known[None], 3, 1, 1)[0]
        map_ = torch.where((map_ < 0) & (least < torch.inf), least, map_)
    return map_
