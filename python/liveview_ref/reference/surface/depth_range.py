"""The depth range of a scene whose files do not give one: from what small copies of its photos
confirm of each other, in a few groups of neighbours, spread over the scene."""

import math

import torch
from torch import Tensor

from ..guided import shrink
from ..views import nearest_first
from .fusion import confirmed
from .photo_depth import View, photo_depth

OUTLIERS = 0.005  # share of the confirmed disparities left out at either end
NEAR_MARGIN, FAR_MARGIN = 1.1, 0.85  # how much wider the range is than the disparities in it
INFINITY = 1e-4  # share of the nearest disparity below which the farthest counts as infinity
MIN_CONFIRMED = 500  # pixels that a range needs
Range = tuple[float, float]  # near and far, scene units


def range_of(disparities: Tensor, searched: Range) -> Range | None:
    """Near and far of confirmed disparities, within the range that was searched; None if
    there are too few."""
    count = len(disparities)
    if count < MIN_CONFIRMED:
        return None
    ordered = disparities.sort().values
    farthest = ordered[int((count - 1) * OUTLIERS)].item() * FAR_MARGIN
    nearest = ordered[int((count - 1) * (1 - OUTLIERS))].item() * NEAR_MARGIN
    if nearest <= 0:
        return None
    far = math.inf if farthest < INFINITY * nearest else 1 / farthest
    found = max(searched[0], 1 / nearest), min(searched[1], far)
    return found if found[0] < found[1] else None


def depth_range(groups: list[list[View]], near: float, far: float) -> Range | None:
    """Near and far of photos in groups of neighbours, searched from `near` to `far`; None if they
    confirm too little."""
    found = []
    for group in groups:
        maps = [(view[1], photo_depth(view, group[:i] + group[i + 1 :], near, far)) for i, view in enumerate(group)]
        found += [depth.disparity[confirmed(i, maps)] for i, (_, depth) in enumerate(maps)]
    return range_of(torch.cat(found), (near, far)) if found else None


GROUPS = 4  # of photos, evenly spread in their order
GROUP_PHOTOS = 5  # of a group: one and its neighbours
SMALL_SIDE = 160.0  # pixels that the longer side is brought closest to, by a whole factor


def found_range(views: list[View]) -> Range | None:
    """Near and far from some of the photos; the widest range that is possible where they confirm
    too little, None if no two neighbouring cameras are in different places."""
    cameras = [camera for _, camera in views]
    around = [[i for i in nearest_first(cameras, camera) if i != own] for own, camera in enumerate(cameras)]
    distances = [float((cameras[i].centre - cameras[a[0]].centre).norm()) for i, a in enumerate(around) if a]
    distances = sorted(distance for distance in distances if distance > 0)
    if not distances:
        return None
    near = distances[len(distances) // 2]
    count = min(GROUPS, len(views))
    middles = [(2 * group + 1) * len(views) // (2 * count) for group in range(count)]
    groups = [[middle, *around[middle]][:GROUP_PHOTOS] for middle in middles]
    small = {i: reduced(views[i]) for group in groups for i in group}
    searched = [[small[i] for i in group] for group in groups if len(group) > 1]
    return depth_range(searched, near, math.inf) or (near, math.inf)


def reduced(view: View) -> View:
    """A photo and its camera at the small size."""
    image, camera = view
    factor = max(math.floor(max(camera.width, camera.height) / SMALL_SIDE + 0.5), 1)
    small = shrink(image, factor) if factor > 1 else image
    return small, camera.with_size_scaled(small.shape[2], small.shape[1])
