"""How much to sharpen each photo before it is warped: what other photos show of the same points says how much detail is
missing from its bilinear samples."""

import torch
import torch.nn.functional as F
from torch import Tensor

from .correspondences import correspondences
from .surface import SurfaceView

SAME = 0.1  # differences from which on two photos do not show the same
MOST = 0.15  # that a photo is sharpened by
ENOUGH = 100  # fewest correspondences that an amount is told from


def sharpening(views: list[SurfaceView]) -> Tensor:
    """Amounts [V]."""
    return torch.stack([amount(view, [other for other in views if other is not view]) for view in views])


def amount(photo: SurfaceView, others: list[SurfaceView]) -> Tensor:
    """The least squares solution of p = s + a d: p what the others show, s the bilinear samples of the photo, d those
    of its detail."""
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
        same = missing.abs() < SAME
        count += int(inner.sum())
        product += (sampled[3:] * missing).double()[same].sum()
        square += (sampled[3:].double() ** 2)[same].sum()
    if count < ENOUGH or square == 0:
        return torch.zeros((), dtype=photo.image.dtype)
    return (product / square).clamp(0, MOST).to(photo.image)


def bilinear(maps: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Samples [C, n] of maps [C, h, w] at columns and rows, px, the centre of the first at 0; all inside."""
    column, row = x.long(), y.long()
    across, down = x - column, y - row
    upper, lower = (torch.lerp(maps[:, j, column], maps[:, j, column + 1], across) for j in (row, row + 1))
    return torch.lerp(upper, lower, down)


def detail(image: Tensor) -> Tensor:
    """4 t - its four neighbours, those outside being the pixel itself."""
    padded = F.pad(image[None], [1, 1, 1, 1], "replicate")[0]
    above, below = padded[:, :-2, 1:-1], padded[:, 2:, 1:-1]
    left, right = padded[:, 1:-1, :-2], padded[:, 1:-1, 2:]
    return 4 * image - above - below - left - right


def sharpened(image: Tensor, amount: Tensor) -> Tensor:
    """The photo [3, h, w] with so much of its detail added."""
    return (image + amount * detail(image)).clamp(0, 1)
