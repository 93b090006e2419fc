"""The warp by kornia's homography_warp, one plane at a time, to compare the reference and the Rust
crate with."""

import torch
from kornia.geometry.transform import homography_warp
from torch import Tensor

from ..reference.geometry.camera import Camera
from ..reference.geometry.plane_sweep import PlaneSweep, source_coordinates
from ..reference.warp import OUTSIDE, grid_from_pixels, normalised_grid, with_coverage


def kornia_samples(image: Tensor, source: Camera, target: Camera, disparity: float, size: tuple[int, int]) -> Tensor:
    """Warp one view by one plane with kornia's homography_warp, unchanged -> colour and coverage
    [4, H, W].

    Convention: kornia takes destination -> source in normalised coordinates; here
    that is source_from_target.
    """
    height, width = size
    normal_source = grid_from_pixels(image.shape[2], image.shape[1])
    normal_target = grid_from_pixels(width, height)
    normalised = (
        normal_source @ PlaneSweep.of(source, target).source_from_target(disparity) @ torch.linalg.inv(normal_target)
    )
    return homography_warp(with_coverage(image)[None], normalised[None].to(image), size, align_corners=False)[0]


def warp_plane_kornia(image: Tensor, source: Camera, target: Camera, disparity: float, size: tuple[int, int]):
    """Warp one view by one plane with kornia -> colour [3, H, W], coverage [H, W]. kornia samples
    points behind the camera (w <= 0) as if in front, hence the mask."""
    rgbc = kornia_samples(image, source, target, disparity, size)
    maps = torch.full((1, *size), disparity, dtype=image.dtype)
    coordinates, w = source_coordinates(PlaneSweep.of(source, target), maps)
    outside = normalised_grid(coordinates, w, image.shape[2], image.shape[1])[0, ..., 0] == OUTSIDE
    rgbc = rgbc.masked_fill(outside, 0.0)
    return rgbc[:3], rgbc[3]
