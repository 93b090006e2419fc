"""Opacity per pixel of parallax: the opacity of a plane depends on the distance to the next plane
behind it.

Where planes lie a tenth of a pixel apart, ten of them show the same surface, and each should take a
tenth of its opacity; where they lie a pixel apart, one should take all. A network that sees one
plane at a time, as the paper's does, cannot know the spacing. So it predicts the odds alpha / (1 -
alpha) for a spacing of one pixel of parallax, and these odds are multiplied by the pixels to the
next plane: their logarithm is added to logit 0. Volume renderers correct opacity for the distance
between samples in the same way (Engel et al., Real-Time Volume Graphics, 2006).
"""

import torch
from torch import Tensor

from .liveview import Camera, padded_size
from .views import widest_parallax_between

LEAST_SPACING = 1e-3  # pixels


def spacing(cameras: list[Camera], target: Camera, disparities: Tensor, most: float) -> Tensor:
    """Pixels of parallax from each of the planes [L], near -> far, to the next behind it, at most
    `most`: [L] float64.

    Measured in the view where they lie farthest apart, as the median over the corners and the
    centre of the padded target, where both planes lie in front of the view. The last plane has the
    spacing of the one before it; a single plane has `most`."""
    if len(disparities) == 1:
        return torch.full((1,), most, dtype=torch.float64)
    size = padded_size(target.height, target.width)
    pixels = widest_parallax_between(cameras, target, disparities, size)
    return torch.cat([pixels, pixels[-1:]]).clamp(LEAST_SPACING, most)


def logit_shift(cameras: list[Camera], target: Camera, disparities: Tensor, most: float) -> Tensor:
    """The value added to logit 0 of each plane: [L] float64."""
    return torch.log(spacing(cameras, target, disparities, most))


def shifted(logits: Tensor, shift: Tensor) -> Tensor:
    """Logits [L, V, H, W] with the shift [L] of each plane added to logit 0."""
    return torch.cat([logits[:, :1] + shift.to(logits)[:, None, None, None], logits[:, 1:]], 1)
