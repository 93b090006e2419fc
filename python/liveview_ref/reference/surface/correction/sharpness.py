"""How much to sharpen each photo before it is warped, estimated from the detail that other photos
show of the same points and its bilinear samples lack."""

import torch
from torch import Tensor

from liveview_ref.reference.render.corrected_photos import detail

from ..fusion.surface_view import SurfaceView
from .correspondences import correspondences

MOST_DIFFERENCE = 0.1  # of colour, between two photos that show the same point
MOST_SHARPENING = 0.15
LEAST_CORRESPONDENCES = 100  # for an amount other than 0


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
