"""Photos brought to the same exposure and sharpness, measured on their correspondences: pixels of
two photos that show the same point, by the confirmed depth of both.

Exposure and white balance: a gain per channel. Sharpness: the detail that other photos show of the
same points and a photo's bilinear samples lack.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from .fusion import SurfaceView, at_pixels, projected

CORRECTED_POWER = 1.5  # of d_min / d_i in the blend of corrected photos
SAMPLE_STEP = 8  # every eighth pixel of every eighth row is used
AGREEMENT = 2.0  # px within which the two depths agree


def correspondences(view: SurfaceView, other: SurfaceView) -> tuple[Tensor, Tensor, Tensor]:
    """Pixels of `view` that have a correspondence [h, w], and their columns and rows
    in `other`, pixels."""
    x, y, there = projected(other.camera, view.camera, view.confirmed.disparity)
    own, inside = at_pixels(other.confirmed.disparity, x, y)
    use = (
        inside & (view.confirmed.disparity >= 0) & (own >= 0) & ((own - there).abs() < AGREEMENT * view.confirmed.pixel)
    )
    sampled = torch.zeros_like(use)
    sampled[::SAMPLE_STEP, ::SAMPLE_STEP] = True
    return use & sampled, x, y


LEAST_VALUE, MOST_VALUE = 0.05, 0.95  # usable values are neither lost in noise nor clipped
LEAST_CORRESPONDENCES = 100  # for a gain other than 1, or an amount other than 0


def exposure_gains(views: list[SurfaceView], distances: Tensor) -> Tensor:
    """Gains [V, 3] of the views; their distances from the target are [V] float64."""
    return balanced(torch.stack(like_first(views)), distances)


def balanced(gains: Tensor, distances: Tensor) -> Tensor:
    """Gains whose geometric mean is 1, weighted by nearness; a photo at the target keeps
    its own colours."""
    at_target = distances == 0
    weight = (at_target.double() if bool(at_target.any()) else 1 / distances).to(gains)
    mean = ((weight[:, None] * gains.log()).sum(0) / weight.sum()).exp()
    return gains / mean


def like_first(views: list[SurfaceView]) -> list[Tensor]:
    """Gains [3] that give each view the exposure of the first, whose gains are 1."""
    return [
        gains(view, views[0]) if index else torch.ones(3, dtype=view.image.dtype) for index, view in enumerate(views)
    ]


def gains(view: SurfaceView, first: SurfaceView) -> Tensor:
    """Per channel, the upper median of the ratios of the first photo's values to this photo's; all
    1 where a channel has too few."""
    use, x, y = correspondences(view, first)
    found = []
    for here, other in zip(view.image, first.image, strict=True):
        here, other = here[use], at_pixels(other, x, y)[0][use]
        usable = (torch.minimum(here, other) >= LEAST_VALUE) & (torch.maximum(here, other) <= MOST_VALUE)
        ratios = (other / here)[usable].sort().values
        if len(ratios) < LEAST_CORRESPONDENCES:
            return torch.ones(3, dtype=view.image.dtype)
        found.append(ratios[len(ratios) // 2])
    return torch.stack(found)


MOST_DIFFERENCE = 0.1  # of colour, between two photos that show the same point
MOST_SHARPENING = 0.15


def sharpening(views: list[SurfaceView]) -> Tensor:
    """Amounts of sharpening [V]."""
    return torch.stack([amount(view, [other for other in views if other is not view]) for view in views])


def amount(photo: SurfaceView, others: list[SurfaceView]) -> Tensor:
    """The least squares solution a of p = s + a d: p the colours of the other photos, s the
    bilinear samples of the photo, d those of its detail."""
    product, square, count = (torch.zeros((), dtype=torch.float64) for _ in range(3))
    height, width = photo.image.shape[1:]
    both = torch.cat([photo.image, detail(photo.image)])
    for other in others:
        use, x, y = correspondences(other, photo)
        x, y = x[use] - 0.5, y[use] - 0.5
        inner = (x >= 1) & (y >= 1) & (x < width - 2) & (y < height - 2)
        sampled = bilinear(both, x[inner], y[inner])
        shown = other.image[:, use][:, inner] * (other.gains / photo.gains)[:, None]
        missing = shown - sampled[:3]
        same = missing.abs() < MOST_DIFFERENCE
        count += int(inner.sum())
        product += (sampled[3:] * missing).double()[same].sum()
        square += (sampled[3:].double() ** 2)[same].sum()
    if count < LEAST_CORRESPONDENCES or square == 0:
        return torch.zeros((), dtype=photo.image.dtype)
    return (product / square).clamp(0, MOST_SHARPENING).to(photo.image)


def bilinear(maps: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Samples [C, n] of maps [C, h, w] at columns and rows, px, the centre of the first at
    0; all inside."""
    column, row = x.long(), y.long()
    across, down = x - column, y - row
    upper, lower = (torch.lerp(maps[:, j, column], maps[:, j, column + 1], across) for j in (row, row + 1))
    return torch.lerp(upper, lower, down)


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
