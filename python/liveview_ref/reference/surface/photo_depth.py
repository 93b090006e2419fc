"""The depth of one photo: a plane sweep with the photo as reference at half resolution, then a
search of a narrow band around its result at full resolution."""

import math
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..guided import median3, shrink
from ..liveview import Camera
from ..views import widest_parallax
from .aggregate import aggregate
from .photo_sweep import NONE, SEGMENT, UNITS_PER_COST, Candidates, Grid, costs, tile_ranges

LEAST_PLANES, MOST_PLANES = 32, 256  # of the first search
PLANE_SPACING = 0.5  # px between two planes of the first search, per pixel of a cell's side
CELL = 2  # pixels a side of a cell of the first search
FINE_STEPS = 2  # steps of the second search per step of the first
NEIGHBOURS = 5  # photos that a photo is matched with
View = tuple[Tensor, Camera]  # a photo [3, h, w] and its camera


class PhotoDisparity(NamedTuple):
    """Disparity [h, w] that a photo's search finds, not yet confirmed by other photos; `pixel`, the
    disparity worth one pixel of parallax in the neighbour with most of it, rounded to float32."""

    disparity: Tensor
    pixel: float


def pixel_of(widest: float, near: float, far: float) -> float:
    """Disparity worth one pixel where the whole range is `widest` pixels (at least one)."""
    return float(np.float32((1 / near - 1 / far) / max(widest, 1)))


def planes_of(camera: Camera, cameras: list[Camera], near: float, far: float, cell: int = CELL) -> tuple[Grid, float]:
    """The grid of the first search and the pixel of parallax of a photo."""
    widest = max(widest_parallax(cameras, camera, near, far, (camera.height, camera.width)), 1)
    count = min(max(math.ceil(widest / (PLANE_SPACING * cell)) + 1, LEAST_PLANES), MOST_PLANES)
    return Grid.of(near, far, count), pixel_of(widest, near, far)


def bands(index: Tensor, parts: int, count: int) -> Tensor:
    """Starts of the two segments [h, w, 2] int64 of each cell, on a finer grid of `count` indices,
    `parts` for each of the coarser grid's.

    n and f are the nearest and farthest index of the 3x3 neighbourhood, in steps of the finer grid.
    f - n < 3: one segment from round((n + f)/2) - 3 on. < 10: two adjacent ones from round((n +
    f)/2) - 7 on. Else one from round(n) - 3 on and one from round(f) - 4 on, the second not before
    the end of the first. All are shifted to lie on the grid; halves are rounded up.
    """
    near, far = (-F.max_pool2d(-index[None], 3, 1, 1)[0] * parts, F.max_pool2d(index[None], 3, 1, 1)[0] * parts)
    last = max(count, 2 * SEGMENT) - 2 * SEGMENT
    middle = round_half_up(0.5 * (near + far))
    first, joined = (middle - 3).clamp(0, last + SEGMENT), (middle - (SEGMENT - 1)).clamp(0, last)
    apart = (round_half_up(near) - 3).clamp(0, last)
    second = torch.maximum((round_half_up(far) - 4).clamp(max=last + SEGMENT), apart + SEGMENT)
    one, two = far - near < 3, far - near < SEGMENT + 2
    starts = (
        torch.where(one, first, torch.where(two, joined, apart)),
        torch.where(one, NONE, torch.where(two, joined + SEGMENT, second)),
    )
    return torch.stack(starts, -1).long()


def round_half_up(x: Tensor) -> Tensor:
    return (x + 0.5).floor()


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


class CellSearch(NamedTuple):
    """The first search of a photo, on cells of `cell` pixels a side: what it searched, and the
    index [h, w] that it found at each cell."""

    photo: Tensor
    grid: Grid
    pixel: float
    costs: Tensor
    index: Tensor

    @classmethod
    def of(
        cls,
        photo: View,
        neighbours: list[View],
        near: float,
        far: float,
        cell: int,
        coarser: PhotoDisparity | None = None,
    ) -> "CellSearch":
        """`coarser`: what a search on cells twice as large found."""
        image, camera = photo
        grid, pixel = planes_of(camera, [c for _, c in neighbours], near, far, cell)
        small = shrink(image, cell)
        candidates = Candidates.all(grid, *small.shape[1:])
        ranges = coarser and tile_ranges(coarser.disparity, grid, small.shape[1:])
        volume = costs(small, camera, [(shrink(n, cell), c) for n, c in neighbours], grid, candidates, cell, ranges)
        return cls(small, grid, pixel, volume, median3(aggregate(volume, small, candidates)))

    def again(self, anchors: Anchors) -> "CellSearch":
        """The cells that are not kept, searched again with these anchors."""
        candidates = Candidates.all(self.grid, *self.photo.shape[1:])
        found = median3(aggregate(anchors.added_to(self.costs, self.grid), self.photo, candidates))
        return self._replace(index=torch.where(anchors.kept, self.index, found))

    def depth(self) -> PhotoDisparity:
        """The depth of each cell."""
        return PhotoDisparity(self.grid.disparity(self.index), self.pixel)


def photo_depth(photo: View, neighbours: list[View], near: float, far: float) -> PhotoDisparity:
    """The depth of `photo` between `near` and `far`, searched among its neighbours (at least
    one)."""
    return refined(photo, neighbours, CellSearch.of(photo, neighbours, near, far, CELL))


def refined(photo: View, neighbours: list[View], first: CellSearch) -> PhotoDisparity:
    """The second search, around the result of the first."""
    image, camera = photo
    fine = first.grid.divided(FINE_STEPS)
    candidates = Candidates.two(bands(first.index, FINE_STEPS, fine.count), *image.shape[1:])
    volume = costs(image, camera, neighbours, fine, candidates, 1)
    index = median3(aggregate(volume, image, candidates))
    return PhotoDisparity(fine.disparity(index), first.pixel)
