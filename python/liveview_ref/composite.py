"""Front-to-back compositing, near -> far (design: "Composite"). No epsilon inside the product."""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass
class Composited:
    """rgb [3, H, W]; disparity [H, W] = sum T a d; transmittance [H, W] = what no layer covered; weights [L, H, W]."""

    rgb: Tensor
    disparity: Tensor
    transmittance: Tensor
    weights: Tensor


def composite(alpha: Tensor, rgb: Tensor, covered: Tensor, maps: Tensor) -> Composited:
    """alpha [L, H, W], rgb [L, 3, H, W], covered [H, W] (of the farthest layer, which is the background: its alpha
    is 1 where any view covers it), maps [L, H, W] disparities."""
    transmittance = torch.ones_like(alpha[0])
    weights = []
    last = len(alpha) - 1
    for k in range(len(alpha)):
        opacity = torch.where(covered, torch.ones_like(alpha[k]), alpha[k]) if k == last else alpha[k]
        weights.append(transmittance * opacity)
        transmittance = transmittance * (1 - opacity)
    weights = torch.stack(weights)
    return Composited((weights[:, None] * rgb).sum(0), (weights * maps).sum(0), transmittance, weights)
