"""Per-view occlusion: a view sees a point unless the view's own confirmed depth there is nearer by
more than a margin. Where it is farther by the margin the view sees past the point: there is no
surface."""

import torch
from torch import Tensor

from liveview_ref.reference.geometry.camera import Camera

from .project import at_pixels, projected


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
