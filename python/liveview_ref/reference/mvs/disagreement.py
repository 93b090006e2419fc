"""How little the views that see a pixel agree about it: the variance of their colours, over a window."""

import torch
from torch import Tensor

from ..camera import Camera
from ..matching_cost import box
from ..warp import warp_maps

MOST = 0.02  # what a pixel costs that fewer than two views see, and the most that any costs


def disagreement(
    views: list[tuple[Tensor, Camera]],
    visible: Tensor,
    target: Camera,
    surface: Tensor,
    offsets: list[float],
    radius: int,
):
    """Disagreement [offsets, h, w] on `surface` [h, w] moved by each of `offsets`; `visible` [V, h, w] is 1 or 0.

    Of the views with a coverage above 0.5 that see the pixel: (sum c^2 - (sum c)^2 / n) / (3 (n - 1)), within 0 and
    0.02.
    """
    maps = torch.stack([(surface + offset).clamp(min=0) for offset in offsets])
    sums, squares, number = 0, 0, 0
    for (image, source), sees in zip(views, visible, strict=True):
        colour, coverage = warp_maps(image, source, target, maps)
        weight = (coverage > 0.5).to(maps) * sees
        c = colour * (weight / torch.where(coverage > 0.5, coverage, 1))[:, None]
        sums = sums + c
        squares = squares + ((c[:, 0] * c[:, 0] + c[:, 1] * c[:, 1]) + c[:, 2] * c[:, 2])
        number = number + weight
    square = (sums[:, 0] * sums[:, 0] + sums[:, 1] * sums[:, 1]) + sums[:, 2] * sums[:, 2]
    variance = (squares - square / number.clamp(min=1)) / (3 * (number - 1).clamp(min=1))
    return box(torch.where(number > 1.5, variance, MOST).clamp(0, MOST), 2 * radius + 1)
