"""An even grid of disparities, and the grid indices at which each cell of a photo is searched.

Index 0 is the nearest disparity, 1/near; index k lies at 1/near - k step. Both numbers are rounded
to float32, whatever the dtype of the search.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

SEGMENT = 8  # consecutive indices that are searched together
NONE = 65535  # start of a second segment where there is only one


class Grid(NamedTuple):
    """`count` disparities, near -> far."""

    nearest: float
    step: float
    count: int

    @classmethod
    def of(cls, near: float, far: float, count: int) -> "Grid":
        """From 1/near to 1/far in `count` disparities (two at least)."""
        step = (1 / near - 1 / far) / (count - 1)
        return cls(float(np.float32(1 / near)), float(np.float32(step)), count)

    def divided(self, parts: int) -> "Grid":
        """The same range, each step divided by `parts`."""
        step = np.float32(self.step) / np.float32(parts)
        return Grid(self.nearest, float(step), (self.count - 1) * parts + 1)

    def index(self, disparity: Tensor) -> Tensor:
        """Index of a disparity, a fraction between two of the grid."""
        return (self.nearest - disparity) / self.step

    def disparity(self, index: Tensor) -> Tensor:
        """Disparity at an index, at least 0."""
        return (self.nearest - index * self.step).clamp(min=0)


class Candidates(NamedTuple):
    """Indices [n, h, w] int64 at which each cell is searched. `there`: those that belong to the
    cell (the others are searched from index 0 on, because neighbouring cells read them). `wins`:
    those that may win."""

    index: Tensor
    there: Tensor
    wins: Tensor

    @classmethod
    def all(cls, grid: Grid, height: int, width: int) -> "Candidates":
        """Every index; their number is rounded up to a multiple of two segments, beyond the end of
        the grid."""
        count = -(-grid.count // (2 * SEGMENT)) * 2 * SEGMENT
        index = torch.arange(count)[:, None, None].expand(count, height, width)
        return cls(index, torch.ones_like(index, dtype=torch.bool), index < grid.count)

    @classmethod
    def two(cls, starts: Tensor, height: int, width: int) -> "Candidates":
        """One or two segments that begin at starts [h/2, w/2, 2]; a pair of starts serves 2
        x 2 cells."""
        starts = starts.long().repeat_interleave(2, 0).repeat_interleave(2, 1)[:height, :width].permute(2, 0, 1)
        there = starts != NONE
        index = torch.where(there, starts, 0)[:, None] + torch.arange(SEGMENT)[:, None, None]
        there = there.repeat_interleave(SEGMENT, 0)
        return cls(index.flatten(0, 1), there, there)
