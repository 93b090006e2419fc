"""The depth of a photo at its edges, moved to the nearer side where other photos show it.

Beside an edge, a search gives some pixels of the near thing the depth behind it. Nothing then hides
their colour from what lies behind, and pictures show it there.

The depths of the other photos are splatted to the photo; only those count that two of them have.
Such a depth replaces the photo's own where it is nearer, the photo's own has an edge, other photos
confirm most of what is around, and its colour cost is not higher.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from liveview_ref.reference.geometry.camera import Camera

from ..correction.sharpness import bilinear
from ..search.photo_depth import PhotoDepth, View
from .consistency import AGREEMENT
from .project import projected
from .splat import FUSED, splat

EDGE = 3.0  # px by which the photo's own depth differs at an edge
EDGE_RADIUS = 2  # pixels within which it does
LEAST_CONFIRMED = 0.5  # share of the pixels around that other photos confirm
WINDOW_RADIUS = 15  # pixels that are around
MOST_DIFFERENCE = 0.2  # of colour; also outside a photo


def nearer_edges(which: int, photos: list[View], maps: list[PhotoDepth], confirmed: Tensor) -> Tensor:
    """Disparity [h, w] of photo `which` of a set; `confirmed` [h, w] are its pixels that the others
    confirm."""
    image, camera = photos[which]
    own, pixel = maps[which]
    others = [other for i, other in enumerate(photos) if i != which]
    of_others = [(photos[i][1], maps[i].disparity) for i in range(len(photos)) if i != which]
    if not others:
        return own
    nearer = splat(of_others, camera, *own.shape, AGREEMENT * pixel, FUSED * pixel, single=False)
    costs = [colour_cost(image, camera, others, map_) for map_ in (nearer, own)]
    use = (nearer > own + AGREEMENT * pixel) & (spread(own) > EDGE * pixel) & (costs[0] <= costs[1])
    return torch.where(use & (share(confirmed) > LEAST_CONFIRMED), nearer, own)


def spread(map_: Tensor) -> Tensor:
    """Largest minus smallest value [h, w] around each pixel."""
    largest, smallest = (F.max_pool2d(m[None], 2 * EDGE_RADIUS + 1, 1, EDGE_RADIUS)[0] for m in (map_, -map_))
    return largest + smallest


def share(confirmed: Tensor) -> Tensor:
    """Share [h, w] of the pixels around each pixel that are confirmed."""
    side = 2 * WINDOW_RADIUS + 1
    return F.avg_pool2d(confirmed.double()[None], side, 1, WINDOW_RADIUS, count_include_pad=False)[0]


def colour_cost(image: Tensor, camera: Camera, others: list[View], disparity: Tensor) -> Tensor:
    """Mean [h, w] of the two lowest differences of each pixel, at `disparity`, from the other
    photos."""
    found = [torch.full_like(disparity, MOST_DIFFERENCE)] * 2
    for photo, other in others:
        x, y, _ = projected(other, camera, disparity)
        x, y = x - 0.5, y - 0.5
        height, width = photo.shape[1:]
        inside = (x >= 0) & (y >= 0) & (x < width - 1) & (y < height - 1)
        difference = torch.full_like(disparity, MOST_DIFFERENCE)
        shown = bilinear(photo, x[inside], y[inside])
        difference[inside] = (shown - image[:, inside]).abs().mean(0).clamp(max=MOST_DIFFERENCE)
        found.append(difference)
    return torch.stack(found).sort(0).values[:2].mean(0)
