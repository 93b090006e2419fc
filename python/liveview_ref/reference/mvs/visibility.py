"""Who sees what: a view sees a point unless a confirmed depth of its own, there, is nearer by more than a margin."""

import torch
from torch import Tensor

from ..camera import Camera
from .project import at_pixels, projected


def visible(camera: Camera, known: Tensor, target: Camera, disparity: Tensor, margin: float) -> Tensor:
    """1 where the view sees the point of the target's pixels at `disparity` [h, w], or has no pixel there, else 0."""
    x, y, there = projected(camera, target, disparity)
    own, inside = at_pixels(known.to(disparity), x, y)
    return torch.where(inside & ~(own - there < margin), 0, 1).to(disparity)
