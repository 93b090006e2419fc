"""Who sees what: a view sees a point unless a confirmed depth of its own, there, is nearer by more than a margin.

What a view does not see has neither colour nor coverage. Where the coverage that is left, summed over the views, is
0.05 or less, further photos that see the point take the places of the first views, with full coverage; where none does,
all views serve, and the pixel counts as unseen.
"""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ..camera import Camera
from ..warp import with_coverage
from .project import at_pixels, projected

SEEN = 0.05  # coverage, summed over the views, above which a pixel is seen


class Photo(NamedTuple):
    """A photo [3, h, w], its camera and its confirmed depth."""

    image: Tensor
    camera: Camera
    known: Tensor


def visible(camera: Camera, known: Tensor, target: Camera, disparity: Tensor, margin: float) -> Tensor:
    """1 where the view sees the point of the target's pixels at `disparity` [h, w], or has no pixel there, else 0."""
    x, y, there = projected(camera, target, disparity)
    own, inside = at_pixels(known.to(disparity), x, y)
    return torch.where(inside & ~(own - there < margin), 0, 1).to(disparity)


def hide(
    views: list[Photo],
    further: list[Photo],
    target: Camera,
    disparity: Tensor,
    margin: float,
    colour: Tensor,
    coverage: Tensor,
) -> tuple[Tensor, Tensor, Tensor]:
    """Colour [V, 3, h, w] and coverage [V, h, w] of a layer at `disparity` [h, w], without what the views do not see;
    and where any does [h, w] bool."""
    masks = torch.stack([visible(v.camera, v.known, target, disparity, margin) for v in views])
    left = torch.zeros_like(disparity)
    for mask, covered in zip(masks, coverage, strict=True):
        left = left + mask * covered
    unseen = left <= SEEN
    taken = torch.zeros_like(unseen, dtype=torch.int64)
    colour, coverage = colour.clone(), coverage.clone()
    for photo in further:
        sees, sample = seen_colour(photo, target, disparity, margin)
        take = unseen & sees & (taken < len(views))
        masks = torch.where(take & (taken == 0), 0, masks)
        for slot in range(len(views)):
            here = take & (taken == slot)
            masks[slot], coverage[slot] = (torch.where(here, 1, x[slot]) for x in (masks, coverage))
            colour[slot] = torch.where(here, sample, colour[slot])
        taken = taken + take
    masks = torch.where(unseen & (taken == 0), 1, masks)
    return colour * masks[:, None], coverage * masks, (left > SEEN) | (taken > 0)


def seen_colour(photo: Photo, target: Camera, disparity: Tensor, margin: float) -> tuple[Tensor, Tensor]:
    """Where a photo sees the target's pixels at `disparity` [h, w], and its colours there [3, h, w]."""
    x, y, there = projected(photo.camera, target, disparity)
    own, inside = at_pixels(photo.known.to(disparity), x, y)
    height, width = photo.image.shape[1:]
    grid = torch.stack([x / width, y / height], -1) * 2 - 1
    rgbc = F.grid_sample(with_coverage(photo.image)[None], grid[None], padding_mode="zeros", align_corners=False)[0]
    sees = inside & (own - there < margin) & (rgbc[3] > 0.5)
    return sees, rgbc[:3] / torch.where(sees, rgbc[3], 1)
