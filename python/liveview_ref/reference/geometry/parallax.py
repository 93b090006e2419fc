"""Parallax: how far apart two disparities of a target pixel lie in a view, in pixels."""

import torch
from torch import Tensor

from .camera import Camera
from .plane_sweep import PlaneSweep


def widest_parallax(cameras: list[Camera], target: Camera, near: float, far: float, size: tuple[int, int]) -> float:
    """Pixels between near and far in the view where they lie farthest apart: the median over the
    corners and the centre of a target of this size (height, width)."""
    return float(widest_parallax_between(cameras, target, torch.tensor([1 / near, 1 / far], dtype=torch.float64), size))


def widest_parallax_between(
    cameras: list[Camera], target: Camera, disparities: Tensor, size: tuple[int, int]
) -> Tensor:
    """As `widest_parallax`, from each of these disparities [L] to the next, where both lie in front
    of the view: [L - 1] float64."""
    x, y = torch.tensor([[0, 1, 0, 1, 0.5], [0, 0, 1, 1, 0.5]], dtype=torch.float64)
    height, width = size
    pixels = torch.stack([x * width, y * height, torch.ones_like(x)])
    largest = torch.zeros(len(disparities) - 1, dtype=torch.float64)
    for camera in cameras:
        homography, epipole = PlaneSweep.of(camera, target)
        at = homography @ pixels + epipole[:, None] * disparities.double()[:, None, None]  # [L, 3, 5]
        positions = (at[:, :2] / at[:, 2:]).masked_fill(at[:, 2:] <= 0, torch.nan)
        apart = positions.diff(dim=0).norm(dim=1).nanmedian(dim=1).values
        largest = torch.maximum(largest, apart.nan_to_num(nan=0.0))
    return largest
