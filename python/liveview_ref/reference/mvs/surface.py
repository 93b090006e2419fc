"""The target's surface: what the photos know of their depth, carried to the target, filled, refined where it lands."""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ..camera import Camera
from ..guided import guided_search, parallax
from ..layers import guided_maps, padded_size, upsample_maps
from .disagreement import disagreement
from .holes import grown
from .median import median3
from .photo_depth import PhotoDepth, pixel_of
from .settings import Settings
from .splat import splat
from .visibility import visible

OFFSETS = 1.5, 1.0, 0.5, 0.0, -0.5, -1.0, -1.5  # tried by the refinement, in px, near -> far
BETTER = 0.9  # of the first candidate's disagreement, below which the second fills a hole
ROUNDING = 1e-7  # and by this much: all that differs where the photos have no texture
SEARCHED = 4  # most views that the target's own search looks at


class SurfaceView(NamedTuple):
    """A photo with what is known of its depth: -1 where nothing confirms it."""

    image: Tensor
    camera: Camera
    all: PhotoDepth
    known: Tensor


class Surface(NamedTuple):
    """Disparity [h, w] of the padded target, the px of parallax, and the share that no confirmed depth fell on."""

    disparity: Tensor
    pixel: float
    holes: float

    def layers(self, count: int) -> Tensor:
        """`count` layers [L, h, w], near -> far: one follows the surface; more divide the range between its largest and
        its smallest disparity over 3x3 pixels evenly."""
        surface = self.disparity[None]
        near, far = F.max_pool2d(surface, 3, 1, 1)[0], -F.max_pool2d(-surface, 3, 1, 1)[0]
        found = guided_maps(near, self.disparity, far, count)
        return found if count == 1 else torch.cat([found[:-1], far[None]])


def surface(
    views: list[SurfaceView], main: int, target: Camera, near: float, far: float, settings: Settings
) -> Surface:
    """Finds the surface of `target` from the first `main` of the views; the others fill what those do not know."""
    views, further = views[:main], views[main:]
    cameras = [v.camera for v in views]
    pixel = pixel_of(parallax(cameras, target, near, far), near, far)
    size = padded_size(target.height, target.width)
    map_ = splat([(v.camera, v.known) for v in views], target, *size, settings.fuse * pixel)
    if further:
        more = splat([(v.camera, v.known) for v in further], target, *size, settings.fuse * pixel)
        map_ = torch.where(map_ < 0, more, map_)
    empty = map_ < 0
    filled = grown(map_)
    if settings.second and bool(empty.any()):
        filled = choose(
            views, target, empty, filled, second(views, target, near, far, pixel, settings), pixel, settings
        )
    found = median3(filled)
    for _ in range(settings.refine):
        judges = views[: settings.judges]
        found = refined(judges, seen(judges, target, found, pixel, settings), target, found, pixel, settings)
    return Surface(found, pixel, float(empty.double().mean()))


def second(
    views: list[SurfaceView], target: Camera, near: float, far: float, pixel: float, settings: Settings
) -> Tensor:
    """What holes may be filled with: the surface that a search at the target finds, or all depths, confirmed or not."""
    if settings.searched:
        first = views[:SEARCHED]
        found = guided_search([v.image for v in first], [v.camera for v in first], target, near, far)
        return upsample_maps(found.surface[None])[0]
    size = padded_size(target.height, target.width)
    maps = [(v.camera, v.all.disparity.to(v.image)) for v in views]
    return grown(splat(maps, target, *size, settings.fuse * pixel))


def choose(
    views, target: Camera, empty: Tensor, first: Tensor, other: Tensor, pixel: float, settings: Settings
) -> Tensor:
    """`first`, but in holes `other` where the views that see it disagree clearly less about it."""
    pairs = [(v.image, v.camera) for v in views]
    a, b = (
        disagreement(pairs, seen(views, target, m, pixel, settings), target, m, [0.0], 3)[0] for m in (first, other)
    )
    return torch.where(empty & (b < BETTER * a - ROUNDING), other, first)


def seen(views: list[SurfaceView], target: Camera, map_: Tensor, pixel: float, settings: Settings) -> Tensor:
    """Visibility [V, h, w] of a surface."""
    return torch.stack([visible(v.camera, v.known, target, map_, settings.hides * pixel) for v in views])


def refined(views, sees: Tensor, target: Camera, map_: Tensor, pixel: float, settings: Settings) -> Tensor:
    """The surface moved to the offset of the least disagreement (ties: the nearer) and to the parabola's vertex;
    median."""
    offsets = torch.tensor(OFFSETS, dtype=map_.dtype)
    pairs = [(v.image, v.camera) for v in views]
    moves = [float(o) for o in offsets * pixel]
    cost = disagreement(pairs, sees, target, map_, moves, settings.refine_radius)
    cost = cost + (settings.stay * offsets * offsets)[:, None, None]
    places = torch.arange(len(cost))[:, None, None]
    best = torch.where(cost == cost.amin(0), places, len(cost)).amin(0, keepdim=True)
    before, after = (best - 1).clamp(min=0), (best + 1).clamp(max=len(cost) - 1)
    nearer, own, farther = (cost.gather(0, k)[0] for k in (before, best, after))
    curvature = nearer - 2 * own + farther
    inner = ((before < best) & (best < after))[0] & (curvature > 0)
    shift = torch.where(inner, 0.5 * (nearer - farther) / torch.where(inner, curvature, 1), 0)
    return median3((map_ + (offsets[best[0]] - 0.5 * shift) * pixel).clamp(min=0))
