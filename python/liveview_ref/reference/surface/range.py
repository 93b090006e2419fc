"""The depth range of a scene whose files do not give one: from what small copies of its photos
confirm of each other."""

import math

import torch
from torch import Tensor

from .fusion.consistency import confirmed
from .search.photo_depth import View, photo_depth

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
