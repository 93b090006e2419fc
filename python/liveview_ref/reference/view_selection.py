"""Which photos a target is rendered from, and how far they are from it."""

import torch
from torch import Tensor

from .camera import Camera

MIN_COSINE = 0.5  # optical axes further apart than this (60 degrees) look at different things


def looking_the_same_way(cameras: list[Camera], target: Camera) -> list[int]:
    """Indices of the cameras whose optical axis is within 60 degrees of the target's."""
    return [i for i, c in enumerate(cameras) if float(c.forward @ target.forward) > MIN_COSINE]


def choose_views(cameras: list[Camera], target: Camera, count: int) -> list[int]:
    """Indices of the `count` cameras nearest to the target, nearest first, among those that look the same way. Ties
    keep the order of the list. ValueError where too few do."""
    looking = looking_the_same_way(cameras, target)
    if len(looking) < count:
        raise ValueError(f"{count} views asked for, but only {len(looking)} of {len(cameras)} look the target's way")
    return sorted(looking, key=lambda i: float((cameras[i].centre - target.centre).norm()))[:count]


def view_distances(cameras: list[Camera], target: Camera) -> Tensor:
    """Distance of each camera's centre to the target's, scene units, [V] float64."""
    return torch.stack([(c.centre - target.centre).norm() for c in cameras])
