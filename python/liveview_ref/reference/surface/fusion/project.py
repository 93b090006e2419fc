"""Projection of one camera's map into another camera: pixel positions, and disparities there."""

import torch
from torch import Tensor

from liveview_ref.reference.geometry.camera import Camera
from liveview_ref.reference.geometry.plane_sweep import PlaneSweep


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
