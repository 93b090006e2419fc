"""Warp source views to the target at a layer's disparities: colour and coverage.

Bilinear, zeros outside the image; a sample is valid if w > 0 (in front of the source
camera). Coordinates that are not finite, are huge or have w <= 0 are moved outside the image
before sampling, since grid_sample would sample them. Coverage is the same bilinear sample of
an all-ones image.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from .geometry.camera import Camera
from .geometry.plane_sweep import PlaneSweep, source_coordinates

OUTSIDE = -2.0  # normalised coordinate, beyond the footprint of any border pixel


def with_coverage(image: Tensor) -> Tensor:
    """[3, H, W] -> [4, H, W]: adds the all-ones channel whose sample is the coverage."""
    return torch.cat([image, torch.ones_like(image[:1])])


def normalised_grid(coordinates: Tensor, w: Tensor, width: int, height: int) -> Tensor:
    """Pixel coordinates [..., 2] -> grid_sample's [-1, 1] (align_corners=False); invalid ones are
    moved outside."""
    return outside_masked(coordinates / torch.tensor([width, height]).to(coordinates) * 2 - 1, w)


def outside_masked(grid: Tensor, w: Tensor) -> Tensor:
    """Normalised coordinates [..., 2]; those that are not in front (w [...] <= 0), not finite or
    huge become OUTSIDE."""
    valid = (w > 0) & torch.isfinite(grid).all(-1) & (grid.abs() < 1e6).all(-1)
    return torch.where(valid[..., None], grid, torch.full_like(grid, OUTSIDE))


def warp_maps(image: Tensor, source: Camera, target: Camera, maps: Tensor, scale: float = 1.0) -> tuple[Tensor, Tensor]:
    """Warp one view by disparity maps [L, H, W] -> colour [L, 3, H, W], coverage [L, H, W].

    `image` is [3, Hs, Ws] at 1/scale of the source's resolution; maps lie on a grid of `scale`
    target pixels.
    """
    layers, height, width = maps.shape
    coordinates, w = source_coordinates(PlaneSweep.of(source, target), maps, scale)
    grid = normalised_grid(coordinates / scale, w, image.shape[2], image.shape[1])
    stacked = grid.reshape(1, layers * height, width, 2)  # one image for all layers, without a copy per layer
    rgbc = F.grid_sample(with_coverage(image)[None], stacked, padding_mode="zeros", align_corners=False)
    rgbc = rgbc.reshape(4, layers, height, width).transpose(0, 1)
    return rgbc[:, :3], rgbc[:, 3]


def grid_from_pixels(width: int, height: int) -> Tensor:
    """[-1, 1] coordinates from pixels, [3, 3] float64."""
    return torch.tensor([[2 / width, 0, -1], [0, 2 / height, -1], [0, 0, 1]], dtype=torch.float64)
