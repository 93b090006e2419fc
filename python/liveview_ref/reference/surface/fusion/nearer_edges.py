"""The depth of a photo at its edges, moved to the nearer side where other photos show it.

Beside an edge, a search gives some pixels of the near surface the depth of the background, and
pictures show their colour on the background.

The depths of the other photos are splatted to the photo; only those count that two of them have.
Such a depth replaces the photo's own where it is nearer, the photo's own has an edge, other photos
confirm most of what is around, and its colour cost is not higher.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from liveview_ref.reference.geometry.camera import Camera
from liveview_ref.reference.layers.guided.matching_cost import box
from liveview_ref.reference.warp import warp_maps

from ..search.photo_depth import PhotoDepth, View
from .consistency import AGREEMENT
from .splat import FUSED, splat

EDGE = 3.0  # px by which the photo's own depth differs at an edge
EDGE_RADIUS = 2  # pixels within which it does
LEAST_CONFIRMED = 0.5  # share of the pixels around that other photos confirm
WINDOW = 31  # side of the window around a pixel
MOST_DIFFERENCE = 0.2  # of colour; also outside a photo
INSIDE = 1 - 1e-4  # coverage of a sample inside a photo; positions in float32 are exact to some 1e-6 px


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
