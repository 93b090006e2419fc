"""Opacity per pixel of parallax: how opaque a plane is, by how far the next one behind it lies.

Where planes lie a tenth of a pixel apart, ten of them show the same surface, and each should take a tenth of it; where
they lie a pixel apart, one should take all. A network that is shown one plane at a time, as the paper's is, cannot
know. So it gives the odds alpha / (1 - alpha) of a plane that is followed by a pixel of parallax, and a plane has those
odds times the pixels to the next one: the logarithm of these pixels is added to logit 0. Volume renderers correct
opacity for the distance between samples in the same way (Engel et al., Real-Time Volume Graphics, 2006).
"""

import torch
from torch import Tensor

from .camera import Camera
from .guided import parallax_between

LEAST = 1e-3  # pixels


def spacing(cameras: list[Camera], target: Camera, disparities: Tensor, most: float) -> Tensor:
    """Pixels of parallax from each of the planes [L], near -> far, to the next behind it, at most `most`; [L] float64.
    In the view where they lie farthest apart, the median over the corners and the centre of the padded target, where
    both planes lie in front of the view. The last plane's are those of the one before it; those of a single plane are
    `most`."""
    if len(disparities) == 1:
        return torch.full((1,), most, dtype=torch.float64)
    pixels = parallax_between(cameras, target, disparities)
    return torch.cat([pixels, pixels[-1:]]).clamp(LEAST, most)


def logit_shift(cameras: list[Camera], target: Camera, disparities: Tensor, most: float) -> Tensor:
    """What is added to the planes' logits 0: [L] float64."""
    return torch.log(spacing(cameras, target, disparities, most))


def shifted(logits: Tensor, shift: Tensor) -> Tensor:
    """Logits [L, V, H, W], the planes' shift [L] added to logit 0."""
    return torch.cat([logits[:, :1] + shift.to(logits)[:, None, None, None], logits[:, 1:]], 1)
