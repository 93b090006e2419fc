"""source_from_target of a layer: which point of a source image a target pixel sees at a given disparity.

For target pixel p and disparity d: (u, v, w) = H_inf p + d e, with H_inf = K_s R K_t^-1 and e = K_s t; the source pixel
is (u/w, v/w). Exact at d = 0, and never in need of 1/d (design: "Homography"; paper section "HWV").
"""

import torch
from torch import Tensor

from .camera import Camera, source_from_target


def sweep_terms(source: Camera, target: Camera) -> tuple[Tensor, Tensor]:
    """(H_inf [3, 3], e [3]) in float64."""
    rotation, translation = source_from_target(source, target)
    return source.k @ rotation @ torch.linalg.inv(target.k), source.k @ translation


def plane_homography(source: Camera, target: Camera, disparity: float) -> Tensor:
    """Source pixel from target pixel for a fronto-parallel plane of the target, [3, 3] float64."""
    homography, e = sweep_terms(source, target)
    homography = homography.clone()
    homography[:, 2] += disparity * e
    return homography


def source_coordinates(terms: tuple[Tensor, Tensor], disparity: Tensor, scale: float = 1.0) -> tuple[Tensor, Tensor]:
    """Pixel coordinates (x, y) [..., H, W, 2] in the source and the projective depth w [..., H, W].

    disparity [..., H, W] sets dtype; `scale` is the size of a pixel of that grid, in target pixels. What does not lie
    in front of the source (w <= 0) is left to the caller.
    """
    homography, e = (term.to(disparity) for term in terms)
    height, width = disparity.shape[-2:]
    y = (torch.arange(height).to(disparity) + 0.5) * scale
    x = (torch.arange(width).to(disparity) + 0.5) * scale
    rays = (homography[:, 0] * x[None, :, None] + homography[:, 1] * y[:, None, None]) + homography[:, 2]
    uvw = rays + disparity[..., None] * e
    w = uvw[..., 2]
    return uvw[..., :2] / w[..., None], w
