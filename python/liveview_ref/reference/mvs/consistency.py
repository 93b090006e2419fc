"""Which depths of a photo other photos confirm."""

from typing import NamedTuple

import torch
from torch import Tensor

from ..camera import Camera
from .photo_depth import PhotoDepth
from .project import at_pixels, projected
from .settings import Settings


class KnownDepth(NamedTuple):
    """Disparities [h, w] of a photo that other photos confirm, -1 elsewhere; `pixel` as PhotoDepth's."""

    disparity: Tensor
    pixel: float


def confirmed(which: int, maps: list[tuple[Camera, PhotoDepth]], settings: Settings) -> Tensor:
    """Confirmed pixels [h, w] of map `which`: at least one other map agrees within `agree` px, and no more lie `past`
    px behind than agree. Of a map alone nothing is confirmed."""
    camera, (disparity, pixel) = maps[which]
    agree = torch.zeros_like(disparity, dtype=torch.int64)
    seen_past = agree.clone()
    for other, found in maps[:which] + maps[which + 1 :]:
        x, y, there = projected(other, camera, disparity)
        own, inside = at_pixels(found.disparity.to(disparity), x, y)
        nearer = own - there
        agree += inside & (nearer.abs() < settings.agree * pixel)
        seen_past += inside & (nearer < -settings.past * pixel)
    return (agree >= 1) & (agree >= seen_past)


def known(found: PhotoDepth, confirmed: Tensor) -> KnownDepth:
    """Of what a search found, what is confirmed."""
    return KnownDepth(torch.where(confirmed, found.disparity, -1), found.pixel)
