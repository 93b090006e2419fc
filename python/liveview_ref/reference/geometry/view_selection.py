"""The choice of the photos that a target is rendered from, and their distances."""

import torch
from torch import Tensor

from .camera import Camera

MIN_COSINE = 0.5  # views whose optical axes differ by more than 60 degrees see different things


def looking_the_same_way(cameras: list[Camera], target: Camera) -> list[int]:
    """Indices of the cameras whose optical axis is within 60 degrees of the target's."""
    return [i for i, c in enumerate(cameras) if float(c.forward @ target.forward) > MIN_COSINE]


def choose_views(cameras: list[Camera], target: Camera, count: int) -> list[int]:
    """Indices of the `count` cameras nearest to the target, nearest first, among those within 60
    degrees of its optical axis. Ties keep the order of the list. ValueError if there are too
    few."""
    looking = looking_the_same_way(cameras, target)
    if len(looking) < count:
        raise ValueError(
            f"{count} views are needed, but only {len(looking)} of {len(cameras)} face the target's direction"
        )
    return nearest_first(cameras, target)[:count]


def nearest_first(cameras: list[Camera], target: Camera) -> list[int]:
    """Indices of all cameras within 60 degrees of the target's optical axis, nearest first."""
    looking = looking_the_same_way(cameras, target)
    return sorted(looking, key=lambda i: float((cameras[i].centre - target.centre).norm()))


def view_distances(cameras: list[Camera], target: Camera) -> Tensor:
    """Distance of each camera centre to the target's, scene units, [V] float64."""
    return torch.stack([(c.centre - target.centre).norm() for c in cameras])
