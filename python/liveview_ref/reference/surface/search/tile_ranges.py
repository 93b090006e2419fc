"""Which planes of a grid of many each tile of a photo is searched at: those around what a search on
cells twice as large found there.

For a tile of 24 x 63 cells: from the nearest to the farthest index that the coarser map has in the
tile and in its six cells around it, 8 planes more at either end, in whole segments of 8. Grids of
at most 64 planes are searched at all.
"""

import torch
from torch import Tensor

from .grid import SEGMENT, Grid

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
