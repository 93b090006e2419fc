"""The depth of a photo, with what its neighbours find at a small size as anchors: where there is no
texture, the costs alone decide nothing.

1. The photo and its neighbours are one group; each is searched among its own neighbours (here: the
   others of the group) on cells of 4 x 4 pixels, of many planes around what a search on cells of
   8 x 8 found. What the others of the group confirm of it is kept.
2. The first search of the photo, around its map of step 1. A cell is kept where the group's maps
   confirm it, and where they confirm more than a third of the cells around it.
3. Anchors: the cell's own depth where it is confirmed; elsewhere the group's confirmed depths
   splatted to the photo, but not at their edges.
4. The cells that are not kept are searched again with the anchors; then the whole photo around the
   result.

A photo without detail of one pixel (enlarged or soft) is searched at the size that holds its
detail.
"""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ..guided import box, shrink
from ..liveview import Camera
from .fusion import AGREEMENT, FUSED, confirmed, splat
from .photo_depth import CELL, Anchors, CellSearch, PhotoDisparity, View, planes_of, refined
from .photo_sweep import has_many_planes

SOFT_SHARE = 0.22  # of the detail at half the size, below which that size has all the detail
MIN_SIDE = 240  # pixels; shorter side of the smallest photo


def detail_pixels(photo: Tensor) -> int:
    """Pixels a side of the finest detail of a photo [3, h, w]: a power of two.

    While a photo's detail is below SOFT_SHARE of that of the photo at half its size, the smaller
    one takes its place.
    """
    pixels, half = 1, shrink(photo, 2)
    while min(half.shape[1:]) >= MIN_SIDE and mean_square_detail(photo) < SOFT_SHARE * mean_square_detail(half):
        pixels, photo, half = 2 * pixels, half, shrink(half, 2)
    return pixels


def mean_square_detail(photo: Tensor) -> Tensor:
    """Mean square, over the inner pixels, of 4 times a pixel's grey less its four neighbours."""
    grey = photo.mean(0)
    inner = 4 * grey[1:-1, 1:-1]
    detail = inner - grey[1:-1, :-2] - grey[1:-1, 2:] - grey[:-2, 1:-1] - grey[2:, 1:-1]
    return (detail**2).mean()


SMALL_CELL = 4  # pixels a side of a cell of the small maps
LARGER_CELL = 8  # the same of the search before it, where there are many planes
GROUP_PIXELS = 2.0  # px that count as one when the group's maps are compared
WINDOW = 31  # cells; side of the window that decides whether a hole is kept
EDGE = 20.0  # px by which depths within 3 x 3 cells differ where none is carried over


def anchored_depth(photo: View, neighbours: list[View], near: float, far: float) -> PhotoDisparity:
    """As photo_depth, with anchors.

    A photo without detail of one pixel is searched at the size that holds its detail, as are its
    neighbours; all pixels of a cell have its depth.
    """
    cell = detail_pixels(photo[0])
    if cell == 1:
        return depth_at_full_size(photo, neighbours, near, far)
    small, *around = [(shrink(image, cell), camera.shrunk(cell)) for image, camera in [photo, *neighbours]]
    found = depth_at_full_size(small, around, near, far)
    height, width = photo[0].shape[1:]
    enlarged = found.disparity.repeat_interleave(cell, 0).repeat_interleave(cell, 1)
    return found._replace(disparity=enlarged[:height, :width])


def depth_at_full_size(photo: View, neighbours: list[View], near: float, far: float) -> PhotoDisparity:
    """As anchored_depth, of a photo with detail of one pixel."""
    group = Group.of([photo, *neighbours], near, far)
    first = CellSearch.of(photo, neighbours, near, far, CELL, group.maps[0][1])
    return refined(photo, neighbours, first.again(group.anchors(photo[1].shrunk(CELL), first.depth())))


def small_map(photo: View, others: list[View], near: float, far: float) -> PhotoDisparity:
    """The depth of a photo at the small size, searched among the others."""
    grid, _ = planes_of(photo[1], [camera for _, camera in others], near, far, SMALL_CELL)
    coarser = CellSearch.of(photo, others, near, far, LARGER_CELL).depth() if has_many_planes(grid) else None
    return CellSearch.of(photo, others, near, far, SMALL_CELL, coarser).depth()


class Group(NamedTuple):
    """A photo and its neighbours at a small size: their maps, and what the others confirm of
    each (-1 elsewhere)."""

    maps: list[tuple[Camera, PhotoDisparity]]
    confirmed: list[Tensor]

    @classmethod
    def of(cls, views: list[View], near: float, far: float) -> "Group":
        """Of photos of the full size (two at least), the one in question first."""
        others = [views[:i] + views[i + 1 :] for i in range(len(views))]
        found = [small_map(view, rest, near, far) for view, rest in zip(views, others, strict=True)]
        maps = [(view[1].shrunk(SMALL_CELL), map_) for view, map_ in zip(views, found, strict=True)]
        return cls(maps, [confirmed_by(own, maps[:i] + maps[i + 1 :], GROUP_PIXELS) for i, own in enumerate(maps)])

    def anchors(self, camera: Camera, found: PhotoDisparity) -> Anchors:
        """Anchors of the first photo's cells, whose depth a first search found; `camera` is the
        photo's at their size."""
        own = confirmed_by((camera, found), self.maps[1:], 1)
        kept = mostly_confirmed(own)
        height, width = own.shape
        ratio = SMALL_CELL // CELL
        carried = self.carried(found.pixel).repeat_interleave(ratio, 0).repeat_interleave(ratio, 1)[:height, :width]
        return Anchors(kept, torch.where((own >= 0) | kept, own, carried))

    def carried(self, pixel: float) -> Tensor:
        """The confirmed depths splatted to the first photo; -1 in holes and at their edges."""
        target, (shape, _) = self.maps[0][0], self.maps[0][1]
        maps = [(camera, kept) for (camera, _), kept in zip(self.maps, self.confirmed, strict=True)]
        map_ = splat(maps, target, *shape.shape, AGREEMENT * pixel, FUSED * pixel)
        largest = F.max_pool2d(map_[None], 3, 1, 1)[0]
        smallest = -F.max_pool2d(torch.where(map_ < 0, -torch.inf, -map_)[None], 3, 1, 1)[0]
        return torch.where(largest - smallest > EDGE * pixel, -1, map_)


def confirmed_by(
    own: tuple[Camera, PhotoDisparity], others: list[tuple[Camera, PhotoDisparity]], scale: float
) -> Tensor:
    """The disparities of a map that others confirm, with `scale` pixels for one; -1 elsewhere."""
    camera, found = own
    maps = [(camera, found._replace(pixel=scale * found.pixel)), *others]
    return torch.where(confirmed(0, maps), found.disparity, -1)


def mostly_confirmed(own: Tensor) -> Tensor:
    """Cells [h, w] that are confirmed (0 or more), or more than a third of those around them."""
    sure = own >= 0
    return sure | (box(sure.double()[None], WINDOW)[0] > 1 / 3)
