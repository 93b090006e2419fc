"""Matching cost with a photo as reference: the difference between the photo and its neighbours,
warped onto a plane or a band of planes of an even grid of disparities.

Per neighbour and cell, with e the difference of the two colours: 0.5 min(mean |e|, 0.15) + 1.5
min(mean |grad e|, 0.05); grad e are the differences, summed over the channels, to the cells on the
right and below, each at its own k-th candidate, and 0 towards an unseen cell. An unseen cell costs
0.15, the maximum. The cost of a candidate is the mean of its two least costs over the neighbours.

Index 0 of the grid is the nearest disparity, 1/near; index k lies at 1/near - k step. Both numbers
are rounded to float32, whatever the dtype of the search. Grids of at most 64 planes are searched at
all of them; of more, each tile of 24 x 63 cells at those around what a search on cells twice as
large found: from the nearest to the farthest index that the coarser map has in the tile and in its
six cells around it, 8 planes more at either end, in whole segments of 8.
"""

from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..layers import warp_maps
from ..liveview import Camera

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


TILE = 24, 63  # rows, columns
FEW_PLANES = 64  # planes that are searched at everywhere
COARSER_CELL = 2  # cells a side of a cell of the coarser map
REACH = 6  # cells of the coarser map around a tile that count
MARGIN = 8.0  # planes beyond those of the coarser map


def has_many_planes(grid: Grid) -> bool:
    """Whether a grid is searched around what a coarser search found."""
    return grid.count > FEW_PLANES


def tile_ranges(coarser: Tensor, grid: Grid, size: tuple[int, int]) -> Tensor | None:
    """First plane and end [th, tw, 2] int64 of each tile of [h, w] cells, whose disparity a coarser
    search found; None: all planes everywhere."""
    if not has_many_planes(grid):
        return None
    index = grid.index(coarser)
    tiles = [[tile_range(part, grid.count) for part in row] for row in parts(index, size)]
    return torch.tensor(tiles)


def parts(index: Tensor, size: tuple[int, int]) -> list[list[Tensor]]:
    """What counts for each tile."""
    rows, columns = (spans(*of) for of in zip(size, TILE, index.shape, strict=True))
    return [[index[row, column] for column in columns] for row in rows]


def spans(cells: int, side: int, coarser: int) -> list[slice]:
    """Along one axis."""
    ends = [(first, min(first + side, cells)) for first in range(0, cells, side)]
    each = [(first // COARSER_CELL - REACH, -(-end // COARSER_CELL) + REACH) for first, end in ends]
    return [slice(max(first, 0), min(end, coarser)) for first, end in each]


def tile_range(part: Tensor, count: int) -> list[int]:
    near, far = float((part.min() - MARGIN).clamp(min=0)), float(part.max() + MARGIN)
    segments = int(near) // SEGMENT, int(far) // SEGMENT + 1
    return [min(segment * SEGMENT, -(-count // SEGMENT) * SEGMENT) for segment in segments]


def is_searched(ranges: Tensor, count: int, size: tuple[int, int]) -> Tensor:
    """Which of `count` planes [n, h, w] are searched at."""
    first, end = (cells[: size[0], : size[1]] for cells in of_cells(ranges).unbind(-1))
    plane = torch.arange(count)[:, None, None]
    return (plane >= first) & (plane < end)


def of_cells(ranges: Tensor) -> Tensor:
    return ranges.repeat_interleave(TILE[0], 0).repeat_interleave(TILE[1], 1)


UNITS_PER_COST = 32768  # units of the cost volume per unit of colour
COLOUR = 0.5, 0.15  # weight and bound of the difference of colour
GRADIENT = 1.5, 0.05  # weight and bound of the difference of gradient
UNSEEN_COST = COLOUR[0] * COLOUR[1] + GRADIENT[0] * GRADIENT[1]
BEST_NEIGHBOURS = 2  # neighbours whose costs are averaged: those that match best


def costs(
    photo: Tensor,
    camera: Camera,
    neighbours: list[tuple[Tensor, Camera]],
    grid: Grid,
    candidates: Candidates,
    cell: int,
    ranges: Tensor | None = None,
) -> Tensor:
    """Costs [n, h, w] int64 of the candidates, in units of 1/32768 (halves to even). `photo` and
    `neighbours` are shrunk by `cell`; their cameras are those of the full size. With `ranges`
    (tile_ranges.py), planes outside cost what an unseen cell costs."""
    disparity = grid.disparity(candidates.index.to(photo.dtype))
    each = torch.stack([neighbour_cost(photo, camera, *n, disparity, cell) for n in neighbours])
    least = each.sort(0).values[:BEST_NEIGHBOURS]
    total = least[0] + least[1] if len(least) > 1 else least[0]
    found = (total * (UNITS_PER_COST / len(least))).round().long()
    if ranges is None:
        return found
    return torch.where(is_searched(ranges, len(found), found.shape[1:]), found, round(UNSEEN_COST * UNITS_PER_COST))


def neighbour_cost(photo: Tensor, camera: Camera, image: Tensor, source: Camera, disparity: Tensor, cell: int):
    """One neighbour's cost [n, h, w], in units of colour."""
    colour, coverage = warp_maps(image, source, camera, disparity, cell)
    seen = coverage > 0.5
    share = seen.to(photo.dtype) / torch.where(seen, coverage, 1)
    e = (colour * share[:, None] - photo * seen[:, None]).unbind(1)
    difference, signed = (e[0].abs() + e[1].abs()) + e[2].abs(), (e[0] + e[1]) + e[2]
    right = (signed[..., 1:] - signed[..., :-1]).abs() * seen[..., 1:]
    down = (signed[:, 1:] - signed[:, :-1]).abs() * seen[:, 1:]
    gradient = (F.pad(right, (0, 1)) + F.pad(down, (0, 0, 0, 1))) * (1 / 6)
    cost = COLOUR[0] * (difference * (1 / 3)).clamp(max=COLOUR[1]) + GRADIENT[0] * gradient.clamp(max=GRADIENT[1])
    return torch.where(seen, cost, UNSEEN_COST)
