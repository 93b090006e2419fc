"""Who sees what: a view sees a point unless a confirmed depth of its own, there, is nearer by more than a margin.

What a view does not see has neither colour nor coverage. Where the coverage that is left, summed over the views, is
0.05 or less, all views serve, and the pixel counts as unseen.
"""

import torch
from torch import Tensor

from ..camera import Camera
from .project import at_pixels, projected

SEEN = 0.05  # coverage, summed over the views, above which a pixel is seen


def visible(camera: Camera, known: Tensor, target: Camera, disparity: Tensor, margin: float) -> Tensor:
    """1 where the view sees the point of the target's pixels at `disparity` [h, w], or has no pixel there, else 0."""
    x, y, there = projected(camera, target, disparity)
    own, inside = at_pixels(known.to(disparity), x, y)
    return torch.where(inside & ~(own - there < margin), 0, 1).to(disparity)


def hide(
    views: list[tuple[Camera, Tensor]],
    target: Camera,
    disparity: Tensor,
    margin: float,
    colour: Tensor,
    coverage: Tensor,
) -> tuple[Tensor, Tensor, Tensor]:
    """Colour [V, 3, h, w] and coverage [V, h, w] of a layer at `disparity` [h, w], without what the views, of these
    cameras and known depths, do not see; and where any does [h, w] bool."""
    masks = torch.stack([visible(camera, known, target, disparity, margin) for camera, known in views])
    left = torch.zeros_like(disparity)
    for mask, covered in zip(masks, coverage, strict=True):
        left = left + mask * covered
    seen = left > SEEN
    masks = torch.where(seen, masks, 1)
    return colour * masks[:, None], coverage * masks, seen
