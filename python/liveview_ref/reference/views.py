"""The choice of the photos that a target is rendered from, and parallax: how far apart two
disparities of a target pixel lie in a view, in pixels."""

import torch

from .liveview import Camera, PlaneSweep

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


def widest_parallax(cameras: list[Camera], target: Camera, near: float, far: float, size: tuple[int, int]) -> float:
    """Pixels between near and far in the view where they lie farthest apart: the median over the
    corners and the centre of a target of this size (height, width), where both lie in front of the
    view."""
    disparities = torch.tensor([1 / near, 1 / far], dtype=torch.float64)
    x, y = torch.tensor([[0, 1, 0, 1, 0.5], [0, 0, 1, 1, 0.5]], dtype=torch.float64)
    height, width = size
    pixels = torch.stack([x * width, y * height, torch.ones_like(x)])
    largest = 0.0
    for camera in cameras:
        homography, epipole = PlaneSweep.of(camera, target)
        at = homography @ pixels + epipole[:, None] * disparities[:, None, None]  # [2, 3, 5]
        positions = (at[:, :2] / at[:, 2:]).masked_fill(at[:, 2:] <= 0, torch.nan)
        apart = (positions[1] - positions[0]).norm(dim=0).nanmedian()
        largest = max(largest, float(apart.nan_to_num(nan=0.0)))
    return largest
