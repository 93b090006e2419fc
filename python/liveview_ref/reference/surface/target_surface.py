"""The target's surface: the confirmed depths of the photos, fused at the target, holes filled.

1. Splat of the confirmed depths (fusion.py).
2. Holes are filled from their farthest neighbours. If they are more than a share of the target, it
   is searched among the first views, and what that finds replaces this except where the views agree
   clearly better on it.
3. 3x3 median.

The target's own search starts from what the photos confirm. On cells of 4 x 4 pixels: photos are
averaged, the views' confirmed depths and the splat are medians of what a cell holds. The cost of a
plane: the variance of the colours of the views that see it, a cost for each view that sees past it,
and in cells with a splatted depth a cost of the distance from it, the anchor. Aggregated along four
paths, the cheapest plane, 3x3 median, enlarged.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ..guided import box, guided_maps, median3, semi_global, shrink, window_variance, winner_takes_all
from ..layers import upsample_maps, warp_maps
from ..liveview import Camera, padded_size, uniform_disparities
from ..views import widest_parallax
from .fusion import AGREEMENT, FUSED, SurfaceView, splat, visible, visible_or_past
from .photo_depth import pixel_of


def fill_holes(map_: Tensor) -> Tensor:
    """Holes (pixels below 0) take the smallest disparity among their 8 neighbours that have one,
    one ring of pixels at a time, until none is left. A map of holes alone becomes 0."""
    if not bool((map_ >= 0).any()):
        return torch.zeros_like(map_)
    while bool((map_ < 0).any()):
        known = torch.where(map_ >= 0, map_, torch.inf)
        least = -F.max_pool2d(-known[None], 3, 1, 1)[0]
        map_ = torch.where((map_ < 0) & (least < torch.inf), least, map_)
    return map_


MOST_VARIANCE = 0.02  # the bound, and the value where fewer than two views see the pixel, or one sees past it
GREY = 0.5  # subtracted from colours: leaves the variance unchanged, but keeps digits
VARIANCE_WINDOW = 7  # pixels over which the photo variance is averaged


def photo_variance(
    views: list[tuple[Tensor, Camera, Tensor]], visible: Tensor, target: Camera, surface: Tensor
) -> Tensor:
    """Photo variance [h, w] on `surface` [h, w] of photos, cameras and gains [3]; `visible`
    [V, h, w] is 1, 0, or -1 where the view sees past the surface.

    Of the n views with a coverage above 0.5 that see the pixel: (sum c^2 - (sum c)^2 / n) / (3 (n -
    1)), clamped to [0, 0.02]; c is the colour times its gain, minus 0.5.
    """
    sums, squares, number, past = 0, 0, 0, torch.zeros_like(surface, dtype=torch.bool)
    for (image, source, gains), sees in zip(views, visible, strict=True):
        colour, coverage = (x[0] for x in warp_maps(image, source, target, surface[None]))
        weight = (coverage > 0.5).to(surface) * sees.clamp(min=0)
        past |= (coverage > 0.5) & (sees < 0)
        c = colour * (weight / torch.where(coverage > 0.5, coverage, 1)) * gains[:, None, None] - GREY * weight
        sums = sums + c
        squares = squares + ((c[0] * c[0] + c[1] * c[1]) + c[2] * c[2])
        number = number + weight
    square = (sums[0] * sums[0] + sums[1] * sums[1]) + sums[2] * sums[2]
    variance = (squares - square / number.clamp(min=1)) / (3 * (number - 1).clamp(min=1))
    return box(
        torch.where((number > 1.5) & ~past, variance, MOST_VARIANCE).clamp(0, MOST_VARIANCE)[None], VARIANCE_WINDOW
    )[0]


CELL = 4  # target pixels per side of a cell
LEAST_CONFIRMED = 4  # pixels with a depth that give their cell one
PLANE_SPACING = 3.0  # px of parallax between the planes
LEAST_PLANES, MOST_PLANES = 8, 192
SEARCH_WINDOW = 5  # cells over which the variance is averaged
UNSEEN_COST = 0.02  # where fewer than two views see any of them
PAST_COST = 0.01  # of a view that sees past
ANCHOR_COST = 0.07  # of a plane far from the anchor
ANCHOR_REACH = 4.0  # planes from which on that is paid
STEP_PENALTY, JUMP_PENALTY = 0.004, 0.4


def target_search(
    views: list[SurfaceView], target: Camera, splatted: Tensor, near: float, far: float, margin: float
) -> Tensor:
    """Disparity [h, w] of the padded target, whose splat has -1 in holes; `margin` is that of
    visibility."""
    planes = search_planes(views, target, splatted, near, far)
    return cheapest(target_costs(views, target, splatted, planes, margin), planes)


def cheapest(costs: Tensor, planes: Tensor) -> Tensor:
    """Disparity [h, w] of each pixel at these costs [D, h, w] of the planes."""
    maps = planes.to(costs)[:, None, None].expand_as(costs)
    found = winner_takes_all(semi_global(costs, STEP_PENALTY, JUMP_PENALTY), maps)
    return upsample_maps(median3(found)[None], CELL)[0]


def search_planes(views: list[SurfaceView], target: Camera, splatted: Tensor, near: float, far: float) -> Tensor:
    """Disparities [D], near -> far."""
    parallax = widest_parallax([v.camera for v in views], target, near, far, tuple(splatted.shape))
    count = math.ceil(min(parallax / PLANE_SPACING, MOST_PLANES)) + 1
    return uniform_disparities(near, far, min(max(count, LEAST_PLANES), MOST_PLANES))


def target_costs(views: list[SurfaceView], target: Camera, splatted: Tensor, planes: Tensor, margin: float) -> Tensor:
    """Costs [D, h, w] of the planes at the cells."""
    reach = ANCHOR_REACH * float(planes[0] - planes[-1]) / (len(planes) - 1)
    height, width = (side // CELL for side in splatted.shape)
    maps = planes.to(splatted)[:, None, None].expand(-1, height, width)
    colours, coverages, past = [], [], 0
    for view in views:
        colour, coverage = warp_maps(shrink(view.image, CELL), view.camera, target, maps, CELL)
        camera, confirmed = view.camera.shrunk(CELL), cell_medians(view.confirmed.disparity)
        sees = torch.stack([visible_or_past(camera, confirmed, target.shrunk(CELL), map_, margin) for map_ in maps])
        past = past + PAST_COST * ((sees < 0) & (coverage > 0.5)).to(splatted)
        colours.append(colour * view.gains[:, None, None])
        coverages.append(torch.where(sees > 0, coverage, 0))
    costs = window_variance(torch.stack(colours, 1), torch.stack(coverages, 1), SEARCH_WINDOW, UNSEEN_COST)
    anchors = cell_medians(splatted)
    share = ((anchors - maps).abs() / reach).clamp(max=1)
    return costs + (past + torch.where(anchors >= 0, ANCHOR_COST * share, 0))


def cell_medians(map_: Tensor) -> Tensor:
    """The median of the values of each cell of a map [h, w] (-1: none; the lower of the two in the
    middle); -1 where a cell has too few."""
    height, width = map_.shape
    padded = F.pad(map_, (0, -width % CELL, 0, -height % CELL), value=-1)
    values = padded.unfold(0, CELL, CELL).unfold(1, CELL, CELL).flatten(2).sort(descending=True).values
    count = (values >= 0).sum(2, keepdim=True)
    median = values.gather(2, (count // 2).clamp(max=CELL * CELL - 1))[..., 0]
    return torch.where(count[..., 0] >= LEAST_CONFIRMED, median, -1)


SEARCHED_SHARE = 0.05  # of holes in the target, above which it is searched
SEARCHED_VIEWS = 4  # views of that search
OCCLUSION_MARGIN = 4.0  # px by which a view's own depth must be nearer to hide a point
BETTER = 0.9  # share of the search's photo variance below which the first candidate stays
ROUNDING = 1e-7  # and it must be lower by this much: without texture only rounding differs
DOUBTED = 0.002  # photo variance from which on a hole's colour is doubted
DOUBT_WINDOW, MOST_DOUBT = 11, 0.99  # pixels; share of a colour that is not trusted where all around it is doubted


class Surface(NamedTuple):
    """Disparity [h, w] of the padded target, the disparity worth one px, the share of the target
    that no confirmed depth falls on, and how far each pixel's colour is trusted, up to 1 [h, w]."""

    disparity: Tensor
    pixel: float
    holes: float
    confidence: Tensor | None = None

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
    filled, confidence = fill_holes(map_), torch.ones_like(map_)
    if holes > SEARCHED_SHARE:
        searching = views[:SEARCHED_VIEWS]
        margin = OCCLUSION_MARGIN * pixel
        found = target_search(searching, target, map_, near, far, margin)
        filled, variance = choose(searching, target, empty, filled, found, margin)
        doubted = (empty & (variance >= DOUBTED)).to(map_)
        confidence = 1 - MOST_DOUBT * doubted * box(doubted[None], DOUBT_WINDOW)[0]
    return Surface(median3(filled), pixel, holes, confidence)


def choose(
    views: list[SurfaceView], target: Camera, empty: Tensor, first: Tensor, other: Tensor, margin: float
) -> tuple[Tensor, Tensor]:
    """`first`, in holes `other` unless `first` has a clearly lower variance; and the variance."""
    photos = [(v.image, v.camera, v.gains) for v in views]
    a, b = (photo_variance(photos, seen(views, target, m, margin, visible_or_past), target, m) for m in (first, other))
    stays = a < BETTER * b - ROUNDING
    return torch.where(empty & ~stays, other, first), torch.where(stays, a, b)


def seen(views: list[SurfaceView], target: Camera, map_: Tensor, margin: float, by: Callable = visible) -> Tensor:
    """Visibility [V, h, w] of a surface, `by` visible or visible_or_past."""
    return torch.stack([by(v.camera, v.confirmed.disparity, target, map_, margin) for v in views])
