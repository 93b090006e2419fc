"""Layers as maps of disparity per target pixel, near -> far at every pixel, and their warp: what
the homographies of liveview.py are for planes; and the composite, one batch of planes at a time.

The warp is grid_sample's, bilinear, zeros outside; for planes it equals kornia's. Points behind the
source camera and coordinates that are not finite or huge are moved outside the photo before
sampling.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from .liveview import LARGEST, Camera, PlaneSweep, padded_size, with_coverage

CELL = 2  # target pixels per cell of a map
OUTSIDE = -2.0  # normalised coordinate, beyond the footprint of any border pixel


def upsample_maps(coarse: Tensor, factor: int = CELL) -> Tensor:
    """Maps [L, h, w] -> [L, factor h, factor w], bilinear between cell centres, edges repeated."""
    return F.interpolate(coarse[None], scale_factor=factor, mode="bilinear", align_corners=False)[0]


def plane_maps(target: Camera, disparities: Tensor, dtype: torch.dtype) -> Tensor:
    """Planes [D] as maps [D, H8, W8] over the padded target."""
    height, width = padded_size(target.height, target.width)
    return disparities.to(dtype)[:, None, None].expand(-1, height, width)


def source_coordinates(sweep: PlaneSweep, disparity: Tensor, scale: float = 1.0) -> tuple[Tensor, Tensor]:
    """Pixel coordinates (x, y) [..., H, W, 2] in the source and the projective depth w [..., H, W].

    disparity [..., H, W] sets dtype; `scale` is the size of a pixel of that grid, in target pixels.
    Points that do not lie in front of the source (w <= 0) are left to the caller.
    """
    homography, epipole = (term.to(disparity) for term in sweep)
    height, width = disparity.shape[-2:]
    y = (torch.arange(height).to(disparity) + 0.5) * scale
    x = (torch.arange(width).to(disparity) + 0.5) * scale
    rays = (homography[:, 0] * x[None, :, None] + homography[:, 1] * y[:, None, None]) + homography[:, 2]
    uvw = rays + disparity[..., None] * epipole
    w = uvw[..., 2]
    return uvw[..., :2] / w[..., None], w


def normalised_grid(coordinates: Tensor, w: Tensor, width: int, height: int) -> Tensor:
    """Pixel coordinates [..., 2] -> grid_sample's [-1, 1] (align_corners=False); invalid ones are
    moved outside."""
    return outside_masked(coordinates / torch.tensor([width, height]).to(coordinates) * 2 - 1, w)


def outside_masked(grid: Tensor, w: Tensor) -> Tensor:
    """Normalised coordinates [..., 2]; those that are not in front (w [...] <= 0), not finite or
    huge become OUTSIDE."""
    valid = (w > 0) & torch.isfinite(grid).all(-1) & (grid.abs() < LARGEST).all(-1)
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


def warp_views(views: list[Tensor], cameras: list[Camera], target: Camera, maps: Tensor) -> tuple[Tensor, Tensor]:
    """Views warped by all layers: colour [L, V, 3, H, W], coverage [L, V, H, W]."""
    warped = [warp_maps(v, c, target, maps) for v, c in zip(views, cameras, strict=True)]
    return torch.stack([rgb for rgb, _ in warped], 1), torch.stack([coverage for _, coverage in warped], 1)


State = tuple[Tensor, Tensor, Tensor]  # rgb [3, H, W], disparity [H, W], transmittance [H, W] of the planes so far


def empty(size: tuple[int, int]) -> State:
    """The state before the first plane; size (height, width)."""
    return torch.zeros(3, *size), torch.zeros(size), torch.ones(size)


def accumulate(state: State, alpha: Tensor, rgb: Tensor, coverage: Tensor, disparities: Tensor, background: Tensor):
    """`composite` one batch of planes at a time, so that memory does not grow with their number.
    alpha [n, H, W], rgb [n, 3, H, W], coverage [n, V, H, W], disparities [n], background [n] bool
    (true for the farthest plane)."""
    total, disparity, transmittance = state
    opaque = background[:, None, None] & (coverage > 0).any(1)
    alpha = torch.where(opaque, torch.ones_like(alpha), alpha)
    for k in range(len(alpha)):
        weight = transmittance * alpha[k]
        total = total + weight * rgb[k]
        disparity = disparity + weight * disparities[k]
        transmittance = transmittance - weight
    return total, disparity, transmittance
