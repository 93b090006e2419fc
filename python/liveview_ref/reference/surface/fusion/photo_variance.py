"""Photo variance: the variance of the colours of the views that see a pixel, averaged
over a window."""

import torch
from torch import Tensor

from liveview_ref.reference.geometry.camera import Camera
from liveview_ref.reference.layers.guided.matching_cost import box
from liveview_ref.reference.warp import warp_maps

MOST_VARIANCE = 0.02  # the bound, and the value where fewer than two views see the pixel, or one sees past it
GREY = 0.5  # subtracted from colours: leaves the variance unchanged, but keeps digits
WINDOW = 7  # pixels


def photo_variance(
    views: list[tuple[Tensor, Camera, Tensor]], visible: Tensor, target: Camera, surface: Tensor
) -> Tensor:
    """Photo variance [h, w] on `surface` [h, w] of photos, cameras and gains [3]; `visible`
    [V, h, w] is 1, 0, or -1 where the view sees past the surface.

    Of the n views with a coverage above 0.5 that see the pixel: (sum c^2 - (sum c)^2 / n) / (3 (n -
    1)), clamped to [0, 0.02]; c is the colour times its gain, minus 0.5.
    """
    sums, squares, number, past = 0, 0, 0, torch.zeros_like(surface, dtype=torch.bool)
    for (image, source, gains), sees in zip(views, visible, strict=True):
        colour, coverage = (x[0] for x in warp_maps(image, source, target, surface[None]))
        weight = (coverage > 0.5).to(surface) * sees.clamp(min=0)
        past |= (coverage > 0.5) & (sees < 0)
        c = colour * (weight / torch.where(coverage > 0.5, coverage, 1)) * gains[:, None, None] - GREY * weight
        sums = sums + c
        squares = squares + ((c[0] * c[0] + c[1] * c[1]) + c[2] * c[2])
        number = number + weight
    square = (sums[0] * sums[0] + sums[1] * sums[1]) + sums[2] * sums[2]
    variance = (squares - square / number.clamp(min=1)) / (3 * (number - 1).clamp(min=1))
    return box(torch.where((number > 1.5) & ~past, variance, MOST_VARIANCE).clamp(0, MOST_VARIANCE)[None], WINDOW)[0]
