"""The choice of the photos that a target is rendered from, and parallax: how far apart two
disparities of a target pixel lie in a view, in pixels."""

from collections.abc import Sequence

import torch
from torch import Tensor

from .liveview import Camera, PlaneSweep

MIN_COSINE = 0.5  # views whose optical axes differ by more than 60 degrees see different things
POOL = 10  # cameras to choose among
GRID = 12  # points a side of the grid of a target's pixels
DEPTHS = (0.6, 1.0, 2.0)
WORTH = torch.tensor([1, 0.5, 0.25, 0.12, 0.06], dtype=torch.float64)  # of seeing a point, by how many do already
ALIKE = 0.3  # cost of a direction that a chosen camera has already
ROUNDING = 1e-9  # relative, of a cost
KEPT = 0.9  # factor of the cost of a camera that is kept


def looking_the_same_way(cameras: list[Camera], target: Camera) -> list[int]:
    """Indices of the cameras whose optical axis is within 60 degrees of the target's."""
    return [i for i, c in enumerate(cameras) if float(c.forward @ target.forward) > MIN_COSINE]


def choose_views(cameras: list[Camera], target: Camera, count: int, kept: Sequence[int] = ()) -> list[int]:
    """Indices of the `count` cameras to render the target from, nearest first: those that show it,
    from all sides. They are chosen one after another among the ten nearest within 60 degrees of its
    optical axis, each time the one with the lowest cost; of those in `kept` it is a tenth lower. Of
    costs equal but for rounding the nearest is taken. ValueError if there are too few."""
    pool = nearest_first(cameras, target)
    if len(pool) < count:
        raise ValueError(
            f"{count} views are needed, but only {len(pool)} of {len(cameras)} face the target's direction"
        )
    pool = pool[: max(POOL, count)]
    apart = torch.stack([cameras[i].centre - target.centre for i in pool])
    distances = apart.norm(dim=1)
    least = max(ROUNDING * float(distances.max()), torch.finfo(apart.dtype).tiny)  # the target's place has no direction
    directions = torch.nn.functional.normalize(apart, dim=1, eps=least)
    points = points_before(target, focus([cameras[i] for i in pool], target))
    seen = torch.stack([is_in_view(cameras[i], points) for i in pool])
    discount = torch.tensor([KEPT if i in kept else 1.0 for i in pool], dtype=torch.float64)
    times_seen = torch.zeros(len(points), dtype=torch.long)
    chosen: list[int] = []
    while len(chosen) < count:
        alike = (directions @ directions[chosen].T).clamp(min=0).amax(1) if chosen else torch.zeros(len(pool))
        worth = (WORTH[times_seen.clamp(max=len(WORTH) - 1)] * seen).mean(1)
        cost = discount * distances * (1 + ALIKE * alike) / (worth + 1e-3).sqrt()
        free = [i for i in range(len(pool)) if i not in chosen]
        lowest = min(float(cost[i]) for i in free)
        best = next(i for i in free if cost[i] <= (1 + ROUNDING) * lowest)
        times_seen += seen[best]
        chosen.append(best)
    return [pool[i] for i in sorted(chosen)]


def with_helpers(cameras: list[Camera], target: Camera, count: int, helpers: int) -> list[int]:
    """The views to render from, then up to so many more that only help to find depth."""
    views = choose_views(cameras, target, count)
    more = min(count + helpers, len(nearest_first(cameras, target)))
    return views + [i for i in choose_views(cameras, target, more) if i not in views]


def focus(cameras: list[Camera], target: Camera) -> float:
    """Depth (scene units) at which the cameras' optical axes come closest to the target's: the
    median of those in front of both; ten times their median distance if that is at most half of
    them. At least that distance."""
    depths = []
    apart = float((cameras[len(cameras) // 2].centre - target.centre).norm()) if cameras else 0.0
    for camera in cameras:
        from_camera, cosine = target.centre - camera.centre, target.forward @ camera.forward
        a, b = target.forward @ from_camera, camera.forward @ from_camera
        squared_sine = 1 - cosine**2
        depth, of_camera = (cosine * b - a) / squared_sine, (b - cosine * a) / squared_sine
        if squared_sine > 1e-6 and min(depth, of_camera) > 1e-6 * apart:
            depths.append(float(depth))
    depth = sorted(depths)[len(depths) // 2] if 2 * len(depths) > len(cameras) else 10 * apart
    return max(depth, apart)


def points_before(target: Camera, depth: float) -> Tensor:
    """World points [3 * 12 * 12, 3] at the target's pixels in a regular grid, at three depths about
    the given one."""
    steps = (torch.arange(GRID, dtype=torch.float64) + 0.5) / GRID
    y, x = torch.meshgrid(steps * target.height, steps * target.width, indexing="ij")
    rays = torch.stack([x, y, torch.ones_like(x)], -1).reshape(-1, 3) @ torch.linalg.inv(target.k).T
    return torch.cat([(rays * factor * depth - target.translation) @ target.rotation for factor in DEPTHS])


def is_in_view(camera: Camera, points: Tensor) -> Tensor:
    """Which world points [n, 3] lie in a camera's picture: [n] bool."""
    at = points @ camera.rotation.T + camera.translation
    pixels = (at / at[:, 2:]) @ camera.k.T
    inside = (pixels[:, :2] >= 0) & (pixels[:, :2] < torch.tensor([camera.width, camera.height]))
    return (at[:, 2] > 0) & inside.all(1)


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
