"""Gains that bring photos of different exposure or white balance to one between theirs: a factor per channel."""

import torch
from torch import Tensor

from .correspondences import correspondences
from .project import at_pixels
from .surface import SurfaceView

USABLE = 0.05, 0.95  # values that are neither lost in noise nor clipped
ENOUGH = 100  # fewest correspondences that a gain is told from


def exposure_gains(views: list[SurfaceView], distances: Tensor) -> Tensor:
    """Gains [V, 3] of the views, whose distances from the target are [V] float64."""
    return balanced(torch.stack(like_first(views)), distances)


def balanced(gains: Tensor, distances: Tensor) -> Tensor:
    """Gains whose geometric mean is 1, weighted by nearness; a photo at the target keeps its own colours."""
    at_target = distances == 0
    weight = (at_target.double() if bool(at_target.any()) else 1 / distances).to(gains)
    mean = ((weight[:, None] * gains.log()).sum(0) / weight.sum()).exp()
    return gains / mean


def like_first(views: list[SurfaceView]) -> list[Tensor]:
    """Gains [3] of each view towards the first of them, whose own are 1."""
    return [
        gains(view, views[0]) if index else torch.ones(3, dtype=view.image.dtype) for index, view in enumerate(views)
    ]


def gains(view: SurfaceView, first: SurfaceView) -> Tensor:
    """The upper median of the first photo's value over the photo's, by channel; 1 where a channel has too few."""
    use, x, y = correspondences(view, first)
    found = []
    for here, other in zip(view.image, first.image, strict=True):
        here, other = here[use], at_pixels(other, x, y)[0][use]
        usable = (here >= USABLE[0]) & (here <= USABLE[1]) & (other >= USABLE[0]) & (other <= USABLE[1])
        ratios = (other / here)[usable].sort().values
        if len(ratios) < ENOUGH:
            return torch.ones(3, dtype=view.image.dtype)
        found.append(ratios[len(ratios) // 2])
    return torch.stack(found)
