"""Gains that bring photos of different exposure or white balance to a common one: a
factor per channel."""

import torch
from torch import Tensor

from ..fusion.project import at_pixels
from ..fusion.surface_view import SurfaceView
from .correspondences import correspondences

LEAST_VALUE, MOST_VALUE = 0.05, 0.95  # usable values are neither lost in noise nor clipped
LEAST_CORRESPONDENCES = 100  # for a gain other than 1


def exposure_gains(views: list[SurfaceView], distances: Tensor) -> Tensor:
    """Gains [V, 3] of the views; their distances from the target are [V] float64."""
    return balanced(torch.stack(like_first(views)), distances)


def balanced(gains: Tensor, distances: Tensor) -> Tensor:
    """Gains whose geometric mean is 1, weighted by nearness; a photo at the target keeps
    its own colours."""
    at_target = distances == 0
    weight = (at_target.double() if bool(at_target.any()) else 1 / distances).to(gains)
    mean = ((weight[:, None] * gains.log()).sum(0) / weight.sum()).exp()
    return gains / mean


def like_first(views: list[SurfaceView]) -> list[Tensor]:
    """Gains [3] that give each view the exposure of the first, whose gains are 1."""
    return [
        gains(view, views[0]) if index else torch.ones(3, dtype=view.image.dtype) for index, view in enumerate(views)
    ]


def gains(view: SurfaceView, first: SurfaceView) -> Tensor:
    """Per channel, the upper median of the ratios of the first photo's values to this photo's; all
    1 where a channel has too few."""
    use, x, y = correspondences(view, first)
    found = []
    for here, other in zip(view.image, first.image, strict=True):
        here, other = here[use], at_pixels(other, x, y)[0][use]
        usable = (torch.minimum(here, other) >= LEAST_VALUE) & (torch.maximum(here, other) <= MOST_VALUE)
        ratios = (other / here)[usable].sort().values
        if len(ratios) < LEAST_CORRESPONDENCES:
            return torch.ones(3, dtype=view.image.dtype)
        found.append(ratios[len(ratios) // 2])
    return torch.stack(found)
