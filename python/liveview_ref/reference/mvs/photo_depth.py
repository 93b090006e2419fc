"""The depth of one photo: a plane sweep with the photo as reference at half resolution, then a narrow band around what
it finds at full resolution."""

import math
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..camera import Camera
from ..guided import parallax
from ..matching_cost import shrink
from .aggregate import aggregate
from .grid import NONE, SEGMENT, Candidates, Grid
from .median import median3
from .photo_sweep import costs
from .settings import Settings

PLANES = 32, 256  # fewest and most planes of the first search
View = tuple[Tensor, Camera]  # a photo [3, h, w] and its camera


class PhotoDepth(NamedTuple):
    """What a photo's search found, before other photos were asked: disparity [h, w]; `pixel`, what is worth one pixel
    of parallax in the neighbour that sees most of it, as float32."""

    disparity: Tensor
    pixel: float


def pixel_of(widest: float, near: float, far: float) -> float:
    """Disparity worth a pixel where the whole range is `widest` pixels, one at least."""
    return float(np.float32((1 / near - 1 / far) / max(widest, 1)))


def planes_of(camera: Camera, cameras: list[Camera], near: float, far: float, settings: Settings) -> tuple[Grid, float]:
    """The grid of the first search and the pixel of parallax of a photo."""
    widest = max(parallax(cameras, camera, near, far, (camera.height, camera.width)), 1)
    count = min(max(math.ceil(widest / settings.spacing) + 1, PLANES[0]), PLANES[1])
    return Grid.of(near, far, count), pixel_of(widest, near, far)


def bands(index: Tensor, parts: int, count: int) -> Tensor:
    """The two segments [h, w, 2] int64 of each cell: `parts` indices of the finer grid, of `count`, for one of the
    coarser.

    n and f are the nearest and farthest index of the 3x3 neighbourhood, in steps of the finer grid. f - n < 3: one
    segment from round((n + f)/2) - 3 on. < 10: two that join, from round((n + f)/2) - 7 on. Else from round(n) - 3 and
    from round(f) - 4 on, the second not before the end of the first. All moved to lie on the grid; halves are rounded
    up.
    """
    near, far = (-F.max_pool2d(-index[None], 3, 1, 1)[0] * parts, F.max_pool2d(index[None], 3, 1, 1)[0] * parts)
    last = max(count, 2 * SEGMENT) - 2 * SEGMENT
    middle = round_half_up(0.5 * (near + far))
    first, joined = (middle - 3).clamp(0, last + SEGMENT), (middle - (SEGMENT - 1)).clamp(0, last)
    apart = (round_half_up(near) - 3).clamp(0, last)
    second = torch.maximum((round_half_up(far) - 4).clamp(max=last + SEGMENT), apart + SEGMENT)
    one, two = far - near < 3, far - near < SEGMENT + 2
    starts = (
        torch.where(one, first, torch.where(two, joined, apart)),
        torch.where(one, NONE, torch.where(two, joined + SEGMENT, second)),
    )
    return torch.stack(starts, -1).long()


def round_half_up(x: Tensor) -> Tensor:
    return (x + 0.5).floor()


def photo_depth(photo: View, neighbours: list[View], near: float, far: float, settings: Settings) -> PhotoDepth:
    """Searches the depth of `photo` among its neighbours (one at least), from `near` to `far`."""
    image, camera = photo
    grid, pixel = planes_of(camera, [c for _, c in neighbours], near, far, settings)
    half = shrink(image, 2)
    halves = [(shrink(n, 2), c) for n, c in neighbours]
    candidates = Candidates.all(grid, *half.shape[1:])
    volume = costs(half, camera, halves, grid, candidates, 2)
    index = median3(aggregate(volume, half, candidates, settings))
    fine = grid.divided(settings.parts)
    candidates = Candidates.two(bands(index, settings.parts, fine.count), *image.shape[1:])
    volume = costs(image, camera, neighbours, fine, candidates, 1)
    index = median3(aggregate(volume, image, candidates, settings))
    return PhotoDepth(fine.disparity(index), pixel)
