"""Correspondences: pixels of two photos that show the same point, by the confirmed depth of
both."""

import torch
from torch import Tensor

from ..fusion.project import at_pixels, projected
from ..fusion.surface_view import SurfaceView

SAMPLE_STEP = 8  # every eighth pixel of every eighth row is used
AGREEMENT = 2.0  # px within which the two depths agree


def correspondences(view: SurfaceView, other: SurfaceView) -> tuple[Tensor, Tensor, Tensor]:
    """Pixels of `view` that have a correspondence [h, w], and their columns and rows
    in `other`, pixels."""
    x, y, there = projected(other.camera, view.camera, view.confirmed.disparity)
    own, inside = at_pixels(other.confirmed.disparity, x, y)
    use = (
        inside & (view.confirmed.disparity >= 0) & (own >= 0) & ((own - there).abs() < AGREEMENT * view.confirmed.pixel)
    )
    sampled = torch.zeros_like(use)
    sampled[::SAMPLE_STEP, ::SAMPLE_STEP] = True
    return use & sampled, x, y
