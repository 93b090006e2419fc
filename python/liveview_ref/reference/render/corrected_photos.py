"""Photos as they are warped: of the same exposure, and the softer ones sharpened."""

import torch.nn.functional as F
from torch import Tensor


def detail(image: Tensor) -> Tensor:
    """4 times each pixel minus its four neighbours, [3, h, w]; neighbours outside are
    the pixel itself."""
    padded = F.pad(image[None], [1, 1, 1, 1], "replicate")[0]
    above, below = padded[:, :-2, 1:-1], padded[:, 2:, 1:-1]
    left, right = padded[:, 1:-1, :-2], padded[:, 1:-1, 2:]
    return 4 * image - above - below - left - right


def sharpened(image: Tensor, amount: Tensor) -> Tensor:
    """The photo [3, h, w] plus `amount` times its detail, clamped to [0, 1]."""
    return (image + amount * detail(image)).clamp(0, 1)


def corrected(images: list[Tensor], gains: Tensor, amounts: Tensor) -> list[Tensor]:
    """The photos [3, h, w] of the views, sharpened, at their gains [V, 3]; Rust multiplies the
    samples by the gains, which is the same."""
    sharp = [sharpened(image, a) if a != 0 else image for image, a in zip(images, amounts, strict=True)]
    return [image * gain[:, None, None] for image, gain in zip(sharp, gains, strict=True)]
