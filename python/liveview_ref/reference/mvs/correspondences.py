"""Pixels of two photos that show the same point, by what is known of the depth of both."""

import torch
from torch import Tensor

from .project import at_pixels, projected
from .surface import SurfaceView

STEP = 8  # rows and columns between the pixels that are looked at
AGREE = 2.0  # px within which the two depths agree


def correspondences(view: SurfaceView, other: SurfaceView) -> tuple[Tensor, Tensor, Tensor]:
    """Which pixels of `view` have one [h, w], and their columns and rows in `other`, px."""
    x, y, there = projected(other.camera, view.camera, view.known.disparity)
    own, inside = at_pixels(other.known.disparity, x, y)
    use = inside & (view.known.disparity >= 0) & (own >= 0) & ((own - there).abs() < AGREE * view.known.pixel)
    looked_at = torch.zeros_like(use)
    looked_at[::STEP, ::STEP] = True
    return use & looked_at, x, y
