"""The target's surface: what the photos know of their depth, carried to the target, its holes filled."""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ..camera import Camera
from ..guided import guided_search, parallax
from ..layers import guided_maps, padded_size, upsample_maps
from .consistency import KnownDepth
from .disagreement import disagreement
from .holes import grown
from .median import median3
from .photo_depth import pixel_of
from .settings import Settings
from .splat import splat
from .visibility import visible

BETTER = 0.9  # of the first candidate's disagreement, below which the second fills a hole
ROUNDING = 1e-7  # and by this much: all that differs where the photos have no texture
SEARCHED = 4  # views that holes are searched with


class SurfaceView(NamedTuple):
    """A photo with what is known of its depth; its colours are multiplied by gains [3]."""

    image: Tensor
    camera: Camera
    known: KnownDepth
    gains: Tensor


class Surface(NamedTuple):
    """Disparity [h, w] of the padded target, the px of parallax, and the share that no confirmed depth fell on."""

    disparity: Tensor
    pixel: float
    holes: float

    def layers(self, count: int) -> Tensor:
        """`count` layers [L, h, w], near -> far: one follows the surface; two are its largest and its smallest
        disparity over 3x3 pixels, three these with the surface between them; more divide that range evenly."""
        surface = self.disparity[None]
        near, far = F.max_pool2d(surface, 3, 1, 1)[0], -F.max_pool2d(-surface, 3, 1, 1)[0]
        if count == 3:
            return torch.stack([near, self.disparity, far])
        found = guided_maps(near, self.disparity, far, count)
        return found if count == 1 else torch.cat([found[:-1], far[None]])


def surface(views: list[SurfaceView], target: Camera, near: float, far: float, settings: Settings) -> Surface:
    """Finds the surface of `target` from these photos, nearest first (one at least)."""
    pixel = pixel_of(parallax([v.camera for v in views], target, near, far), near, far)
    size = padded_size(target.height, target.width)
    maps = [(v.camera, v.known.disparity) for v in views]
    map_ = splat(maps, target, *size, settings.agree * pixel, settings.fuse * pixel)
    empty = map_ < 0
    holes = float(empty.double().mean())
    filled = grown(map_)
    if holes > settings.search_holes:
        margin = settings.hides * pixel
        filled = choose(views[:SEARCHED], target, empty, filled, searched(views[:SEARCHED], target, near, far), margin)
    return Surface(median3(filled), pixel, holes)


def searched(views: list[SurfaceView], target: Camera, near: float, far: float) -> Tensor:
    """The surface that a search at the target finds."""
    images = [v.image * v.gains[:, None, None] for v in views]
    found = guided_search(images, [v.camera for v in views], target, near, far)
    return upsample_maps(found.surface[None])[0]


def choose(
    views: list[SurfaceView], target: Camera, empty: Tensor, first: Tensor, other: Tensor, margin: float
) -> Tensor:
    """`first`, but in holes `other` where the views that see it disagree clearly less about it."""
    photos = [(v.image, v.camera, v.gains) for v in views]
    a, b = (disagreement(photos, seen(views, target, m, margin), target, m) for m in (first, other))
    return torch.where(empty & (b < BETTER * a - ROUNDING), other, first)


def seen(views: list[SurfaceView], target: Camera, map_: Tensor, margin: float) -> Tensor:
    """Visibility [V, h, w] of a surface."""
    return torch.stack([visible(v.camera, v.known.disparity, target, map_, margin) for v in views])
