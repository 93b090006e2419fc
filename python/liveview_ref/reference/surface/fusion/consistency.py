"""Which depths of a photo other photos confirm."""

import torch
from torch import Tensor

from liveview_ref.reference.geometry.camera import Camera

from ..search.photo_depth import PhotoDepth
from .project import at_pixels, projected

AGREEMENT = 2.0  # px within which two depths of a point agree
SEEN_PAST = 4.0  # px by which another photo's depth must lie behind a point to contradict it


def confirmed(which: int, maps: list[tuple[Camera, PhotoDepth]]) -> Tensor:
    """Confirmed pixels [h, w] of map `which`: at least one other map agrees within AGREEMENT px,
    and no more maps lie SEEN_PAST px behind than agree. A single map confirms nothing."""
    camera, (disparity, pixel) = maps[which]
    agree = torch.zeros_like(disparity, dtype=torch.int64)
    seen_past = agree.clone()
    for other, found in maps[:which] + maps[which + 1 :]:
        x, y, there = projected(other, camera, disparity)
        own, inside = at_pixels(found.disparity.to(disparity), x, y)
        nearer = own - there
        agree += inside & (nearer.abs() < AGREEMENT * pixel)
        seen_past += inside & (nearer < -SEEN_PAST * pixel)
    return (agree >= 1) & (agree >= seen_past)
