"""The plane sweep: where a target pixel at a given disparity lies in a source image.

For target pixel p and disparity d: (u, v, w) = H_inf p + d e, with H_inf = K_s R K_t^-1 and e = K_s
t; the source pixel is (u/w, v/w), in front of the source camera where w > 0. Exact at d = 0, and
1/d is never needed (paper, section "HWV").
"""

from typing import NamedTuple

import torch
from torch import Tensor

from .camera import Camera, source_from_target


class PlaneSweep(NamedTuple):
    """The sweep of one view over the target's disparities: H_inf [3, 3] and e [3], float64."""

    homography_at_infinity: Tensor
    epipole: Tensor

    @classmethod
    def of(cls, source: Camera, target: Camera) -> "PlaneSweep":
        """The sweep of `source` for `target`."""
        rotation, translation = source_from_target(source, target)
        return cls(source.k @ rotation @ torch.linalg.inv(target.k), source.k @ translation)

    def source_from_target(self, disparity: float) -> Tensor:
        """Source pixel from target pixel for the fronto-parallel plane of the target at this
        disparity, [3, 3]."""
        homography = self.homography_at_infinity.clone()
        homography[:, 2] += disparity * self.epipole
        return homography


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
