"""How little the views that see a pixel agree about it: the variance of their colours, over a window."""

import torch
from torch import Tensor

from ..camera import Camera
from ..matching_cost import box
from ..warp import warp_maps

MOST = 0.02  # what a pixel costs that fewer than two views see, and the most that any costs
GREY = 0.5  # what colours are measured from: changes no variance, but spares digits
WINDOW = 7  # pixels


def disagreement(
    views: list[tuple[Tensor, Camera, Tensor]], visible: Tensor, target: Camera, surface: Tensor
) -> Tensor:
    """Disagreement [h, w] on `surface` [h, w] of photos, cameras and gains [3]; `visible` [V, h, w] is 1 or 0.

    Of the views with a coverage above 0.5 that see the pixel: (sum c^2 - (sum c)^2 / n) / (3 (n - 1)), within 0 and
    0.02; c is the colour times its gain, less 0.5.
    """
    sums, squares, number = 0, 0, 0
    for (image, source, gains), sees in zip(views, visible, strict=True):
        colour, coverage = (x[0] for x in warp_maps(image, source, target, surface[None]))
        weight = (coverage > 0.5).to(surface) * sees
        c = colour * (weight / torch.where(coverage > 0.5, coverage, 1)) * gains[:, None, None] - GREY * weight
        sums = sums + c
        squares = squares + ((c[0] * c[0] + c[1] * c[1]) + c[2] * c[2])
        number = number + weight
    square = (sums[0] * sums[0] + sums[1] * sums[1]) + sums[2] * sums[2]
    variance = (squares - square / number.clamp(min=1)) / (3 * (number - 1).clamp(min=1))
    return box(torch.where(number > 1.5, variance, MOST).clamp(0, MOST)[None], WINDOW)[0]
