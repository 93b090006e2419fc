"""The target's surface: the confirmed depths of the photos, fused at the target, holes filled.

1. Splat of the confirmed depths (splat.py).
2. Holes are filled from their farthest neighbours. If they are more than a share of the target, it
   is searched among the first views (target_search.py), and what that finds replaces this except
   where the views agree clearly better on it.
3. 3x3 median.
"""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from liveview_ref.reference.geometry.camera import Camera
from liveview_ref.reference.geometry.parallax import widest_parallax
from liveview_ref.reference.layers.cells import padded_size
from liveview_ref.reference.layers.guided.range_map import guided_maps, median3

from ..neighbourhood import fill_holes
from ..search.photo_depth import pixel_of
from .consistency import AGREEMENT
from .photo_variance import photo_variance
from .splat import FUSED, splat
from .surface_view import SurfaceView
from .target_search import target_search
from .visible import visible, visible_or_past

SEARCHED_SHARE = 0.05  # of holes in the target, above which it is searched
SEARCHED_VIEWS = 4  # views of that search
OCCLUSION_MARGIN = 4.0  # px by which a view's own depth must be nearer to hide a point
BETTER = 0.9  # share of the search's photo variance below which the first candidate stays
ROUNDING = 1e-7  # and it must be lower by this much: without texture only rounding differs


class Surface(NamedTuple):
    """Disparity [h, w] of the padded target, the disparity worth one px, and the share of the
    target that no confirmed depth falls on."""

    disparity: Tensor
    pixel: float
    holes: float

    def layers(self, count: int) -> Tensor:
        """`count` layers [L, h, w], near -> far: one follows the surface; two are its largest and
        its smallest disparity over 3x3 pixels; three are these with the surface between them; more
        divide that range evenly."""
        surface = self.disparity[None]
        near, far = F.max_pool2d(surface, 3, 1, 1)[0], -F.max_pool2d(-surface, 3, 1, 1)[0]
        if count == 3:
            return torch.stack([near, self.disparity, far])
        found = guided_maps(near, self.disparity, far, count)
        return found if count == 1 else torch.cat([found[:-1], far[None]])


def surface(views: list[SurfaceView], target: Camera, near: float, far: float) -> Surface:
    """The surface of `target` from these photos, nearest first (one at least)."""
    size = padded_size(target.height, target.width)
    pixel = pixel_of(widest_parallax([v.camera for v in views], target, near, far, size), near, far)
    maps = [(v.camera, v.confirmed.disparity) for v in views]
    map_ = splat(maps, target, *size, AGREEMENT * pixel, FUSED * pixel)
    empty = map_ < 0
    holes = float(empty.double().mean())
    filled = fill_holes(map_)
    if holes > SEARCHED_SHARE:
        searching = views[:SEARCHED_VIEWS]
        margin = OCCLUSION_MARGIN * pixel
        found = target_search(searching, target, map_, near, far, margin)
        filled = choose(searching, target, empty, filled, found, margin)
    return Surface(median3(filled), pixel, holes)


def choose(
    views: list[SurfaceView], target: Camera, empty: Tensor, first: Tensor, other: Tensor, margin: float
) -> Tensor:
    """`first`, but in holes `other` unless the photo variance of `first` is clearly lower."""
    photos = [(v.image, v.camera, v.gains) for v in views]
    a, b = (photo_variance(photos, seen_or_past(views, target, m, margin), target, m) for m in (first, other))
    return torch.where(empty & ~(a < BETTER * b - ROUNDING), other, first)


def seen(views: list[SurfaceView], target: Camera, map_: Tensor, margin: float) -> Tensor:
    """Visibility [V, h, w] of a surface."""
    return torch.stack([visible(v.camera, v.confirmed.disparity, target, map_, margin) for v in views])


def seen_or_past(views: list[SurfaceView], target: Camera, map_: Tensor, margin: float) -> Tensor:
    """As seen, but -1 where a view sees past the surface."""
    return torch.stack([visible_or_past(v.camera, v.confirmed.disparity, target, map_, margin) for v in views])
