"""Depths that draw the cells of a second aggregation to them."""

from typing import NamedTuple

import torch
from torch import Tensor

from .grid import Grid
from .photo_sweep import UNITS_PER_COST

ANCHOR_COST = 0.05  # of an index far from the anchor
ANCHOR_REACH = 4.0  # indices from the anchor from which on that is paid


class Anchors(NamedTuple):
    """What is known of each cell [h, w] of a search. `kept`: it keeps the depth that it has.
    `disparity`: what it is drawn to, -1 for none."""

    kept: Tensor
    disparity: Tensor

    def added_to(self, costs: Tensor, grid: Grid) -> Tensor:
        """Costs [n, h, w] int64 of a search over this grid, changed: a cell with an anchor pays
        ANCHOR_COST min(|k - k(d)| / ANCHOR_REACH, 1) more; one without pays half, unless it is
        kept."""
        index = torch.arange(len(costs))[:, None, None].to(self.disparity)
        share = ((index - grid.index(self.disparity)).abs() * (1 / ANCHOR_REACH)).clamp(max=1)
        more = (share * (ANCHOR_COST * UNITS_PER_COST)).round().long()
        without = torch.where(self.kept, costs, costs // 2)
        return torch.where(self.disparity >= 0, costs + more, without)
