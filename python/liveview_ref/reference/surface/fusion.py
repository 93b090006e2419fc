"""The depths of several photos together: what other photos confirm of a depth, which views see a
point, the depths projected to a target, and edges moved to the nearer side.

Splat: each pixel is projected as a square with a side of 0.4 pixels; the nearest wins. A point
covers the pixels that contain its four corners (+-0.2 pixel); of each photo's points a pixel keeps
the largest disparity. Over the photos: the largest that another photo confirms within `agree`, or
the largest of all if there is no such pair (unless `single` is false); then the mean, in the order
of the photos, of those at most `fuse` behind it and not above it.

Edges: beside an edge, a search gives some pixels of the near surface the depth of the background,
and pictures show their colour on the background. The depths of the other photos are splatted to the
photo; only those count that two of them have. Such a depth replaces the photo's own where it is
nearer, the photo's own has an edge, other photos confirm most of what is around, and its colour
cost is not higher.
"""

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ..guided import box
from ..layers import warp_maps
from ..liveview import Camera, PlaneSweep
from .photo_depth import PhotoDisparity, View


def projected(other: Camera, here: Camera, disparity: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Column, row and disparity [h, w] in `other` of the pixels of `here` at `disparity`: (u, v, w)
    = H p + d e; columns and rows are -1 and the disparity 0 behind it (w <= 0)."""
    homography, epipole = (term.to(disparity) for term in PlaneSweep.of(other, here))
    height, width = disparity.shape
    x = (torch.arange(width).to(disparity) + 0.5)[None]
    y = (torch.arange(height).to(disparity) + 0.5)[:, None]
    u, v, w = (h[0] * x + h[1] * y + h[2] + disparity * e for h, e in zip(homography, epipole, strict=True))
    front = w > 0
    per_w = torch.where(front, 1 / torch.where(front, w, 1), 0)
    return torch.where(front, u * per_w, -1), torch.where(front, v * per_w, -1), disparity * per_w


def at_pixels(map_: Tensor, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
    """The map's values at the pixels that hold (x, y), and where those are inside."""
    height, width = map_.shape
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    column, row = (torch.where(inside, p, 0).long() for p in (x, y))
    return map_[row, column], inside


AGREEMENT = 2.0  # px within which two depths of a point agree
SEEN_PAST = 4.0  # px by which another photo's depth must lie behind a point to contradict it


def confirmed(which: int, maps: list[tuple[Camera, PhotoDisparity]]) -> Tensor:
    """Confirmed pixels [h, w] of map `which`: at least one other map agrees within AGREEMENT px,
    and no more maps lie SEEN_PAST px behind than agree. A single map confirms nothing."""
    camera, (disparity, pixel) = maps[which]
    agree = torch.zeros_like(disparity, dtype=torch.int64)
    seen_past = agree.clone()
    for other, found in maps[:which] + maps[which + 1 :]:
        x, y, there = projected(other, camera, disparity)
        own, inside = at_pixels(found.disparity.to(disparity), x, y)
        nearer = own - there
        agree += inside & (nearer.abs() < AGREEMENT * pixel)
        seen_past += inside & (nearer < -SEEN_PAST * pixel)
    return (agree >= 1) & (agree >= seen_past)


class ConfirmedDisparity(NamedTuple):
    """Disparities [h, w] of a photo that other photos confirm, -1 elsewhere;
    `pixel` as PhotoDisparity's."""

    disparity: Tensor
    pixel: float

    @classmethod
    def of(cls, found: PhotoDisparity, confirmed: Tensor) -> "ConfirmedDisparity":
        """The result of a search, reduced to the confirmed pixels [h, w]."""
        return cls(torch.where(confirmed, found.disparity, -1), found.pixel)


class SurfaceView(NamedTuple):
    """A photo [3, h, w], its camera and its confirmed depth; gains [3] multiply its colours."""

    image: Tensor
    camera: Camera
    confirmed: ConfirmedDisparity
    gains: Tensor


def visible(camera: Camera, confirmed: Tensor, target: Camera, disparity: Tensor, margin: float) -> Tensor:
    """1 where the view sees the points of the target's pixels at `disparity` [h, w], or they
    project outside its photo, else 0. `confirmed` is the disparity that the view itself confirmed,
    `margin` a difference of disparity."""
    x, y, there = projected(camera, target, disparity)
    own, inside = at_pixels(confirmed.to(disparity), x, y)
    return torch.where(inside & ~(own - there < margin), 0, 1).to(disparity)


def visible_or_past(camera: Camera, confirmed: Tensor, target: Camera, disparity: Tensor, margin: float) -> Tensor:
    """As visible, but -1 where the view's own confirmed depth lies `margin` or more behind the
    point."""
    x, y, there = projected(camera, target, disparity)
    own, inside = at_pixels(confirmed.to(disparity), x, y)
    past = inside & (own >= 0) & (there - own >= margin)
    return torch.where(past, -1, torch.where(inside & ~(own - there < margin), 0, 1)).to(disparity)


HALF_SIDE = 0.2  # of a point's square, target pixels
FUSED = 3.0  # px behind the nearest within which depths are averaged


def splat(
    maps: list[tuple[Camera, Tensor]],
    target: Camera,
    height: int,
    width: int,
    agree: float,
    fuse: float,
    single: bool = True,
) -> Tensor:
    """Disparity [height, width] of the padded target from confirmed depths; -1 where
    no point falls."""
    each = [splat_one(camera, confirmed, target, height, width) for camera, confirmed in maps]
    nearest = first_surface(each, agree, single)
    total, number = torch.zeros_like(nearest), torch.zeros_like(nearest)
    for one in each:
        counts = (one >= 0) & (one <= nearest) & (nearest - one <= fuse)
        total, number = total + torch.where(counts, one, 0), number + counts
    return torch.where(number > 0, total / number.clamp(min=1), nearest)


def first_surface(each: list[Tensor], agree: float, single: bool) -> Tensor:
    """The nearest disparity that lies within `agree` of another photo's, or the nearest of all if
    `single`, else -1."""
    paired = torch.full_like(each[0], -1)
    for one, other in combinations(each, 2):
        near, far = torch.maximum(one, other), torch.minimum(one, other)
        paired = torch.where((far >= 0) & (near - far <= agree), torch.maximum(paired, near), paired)
    return torch.where(paired >= 0, paired, torch.stack(each).amax(0)) if single else paired


def splat_one(camera: Camera, confirmed: Tensor, target: Camera, height: int, width: int) -> Tensor:
    """The largest disparity of a photo's points in each pixel."""
    nearest = torch.full((height * width,), -1, dtype=confirmed.dtype)
    for at, disparity in points(camera, confirmed, target, height, width):
        nearest.scatter_reduce_(0, at, disparity, "amax")
    return nearest.reshape(height, width)


def points(
    camera: Camera, confirmed: Tensor, target: Camera, height: int, width: int
) -> Iterator[tuple[Tensor, Tensor]]:
    """Pixels that the points' corners fall into, and the points' disparities, one corner at a
    time."""
    x, y, disparity = projected(target, camera, confirmed)
    use = (confirmed >= 0) & (x >= -HALF_SIDE) & (y >= -HALF_SIDE) & (x < width + HALF_SIDE) & (y < height + HALF_SIDE)
    x, y, disparity = x[use], y[use], disparity[use]
    for row in ((y - HALF_SIDE).floor().long(), (y + HALF_SIDE).floor().long()):
        for column in ((x - HALF_SIDE).floor().long(), (x + HALF_SIDE).floor().long()):
            inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
            yield (row * width + column)[inside], disparity[inside]


EDGE = 3.0  # px by which the photo's own depth differs at an edge
EDGE_RADIUS = 2  # pixels within which it does
LEAST_CONFIRMED = 0.5  # share of the pixels around that other photos confirm
WINDOW = 31  # side of the window around a pixel
MOST_DIFFERENCE = 0.2  # of colour; also outside a photo
INSIDE = 1 - 1e-4  # coverage of a sample inside a photo; positions in float32 are exact to some 1e-6 px


def nearer_edges(which: int, photos: list[View], maps: list[PhotoDisparity], confirmed: Tensor) -> Tensor:
    """Disparity [h, w] of photo `which` of a set; `confirmed` [h, w] are its pixels that the others
    confirm."""
    image, camera = photos[which]
    own, pixel = maps[which]
    others = [other for i, other in enumerate(photos) if i != which]
    of_others = [(photos[i][1], maps[i].disparity) for i in range(len(photos)) if i != which]
    if not others:
        return own
    nearer = splat(of_others, camera, *own.shape, AGREEMENT * pixel, FUSED * pixel, single=False)
    filled = torch.where(nearer < 0, own, nearer)
    costs = [colour_cost(image, camera, others, map_) for map_ in (filled, own)]
    use = (nearer > own + AGREEMENT * pixel) & (spread(own) > EDGE * pixel) & (costs[0] <= costs[1])
    share = box(confirmed.double()[None], WINDOW)[0]
    return torch.where(use & (share > LEAST_CONFIRMED), nearer, own)


def spread(map_: Tensor) -> Tensor:
    """Largest minus smallest value [h, w] around each pixel."""
    largest, smallest = (F.max_pool2d(m[None], 2 * EDGE_RADIUS + 1, 1, EDGE_RADIUS)[0] for m in (map_, -map_))
    return largest + smallest


def colour_cost(image: Tensor, camera: Camera, others: list[View], disparity: Tensor) -> Tensor:
    """Mean [h, w] of the two lowest differences from the other photos along `disparity`, each
    averaged over 3x3 pixels."""
    found = [torch.full_like(disparity, MOST_DIFFERENCE)] * 2
    for photo, other in others:
        colour, coverage = (x[0] for x in warp_maps(photo, other, camera, disparity[None]))
        difference = (colour - image).abs().mean(0).clamp(max=MOST_DIFFERENCE)
        difference = torch.where(coverage > INSIDE, difference, MOST_DIFFERENCE)
        found.append(box(difference[None], 3)[0])
    return torch.stack(found).sort(0).values[:2].mean(0)
