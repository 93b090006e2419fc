"""Which depths of a photo other photos confirm."""

import torch
from torch import Tensor

from ..camera import Camera
from .photo_depth import PhotoDepth
from .project import at_pixels, projected
from .settings import Settings


def confirmed(which: int, maps: list[tuple[Camera, PhotoDepth]], settings: Settings) -> Tensor:
    """Confirmed pixels [h, w] of map `which`: at least `votes` other maps (or all, if fewer) agree within `agree` px,
    and no more lie `past` px behind than agree. Of a map alone nothing is confirmed."""
    camera, (disparity, pixel) = maps[which]
    agree = torch.zeros_like(disparity, dtype=torch.int64)
    seen_past = agree.clone()
    others = maps[:which] + maps[which + 1 :]
    for other, found in others:
        x, y, there = projected(other, camera, disparity)
        own, inside = at_pixels(found.disparity.to(disparity), x, y)
        nearer = own - there
        agree += inside & (nearer.abs() < settings.agree * pixel)
        seen_past += inside & (nearer < -settings.past * pixel)
    return (agree >= max(min(settings.votes, len(others)), 1)) & (agree >= seen_past)


def known(found: Tensor, confirmed: Tensor) -> Tensor:
    """Of what a search found, what is confirmed; -1 elsewhere."""
    return torch.where(confirmed, found, -1)
