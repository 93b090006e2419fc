"""Front-to-back compositing, near -> far. No epsilon inside the product."""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass
class Composited:
    """rgb [3, H, W]; disparity [H, W] = sum T a d; transmittance [H, W] left behind the last layer;
    weights [L, H, W]."""

    rgb: Tensor
    disparity: Tensor
    transmittance: Tensor
    weights: Tensor


def composite(alpha: Tensor, rgb: Tensor, covered: Tensor, maps: Tensor) -> Composited:
    """alpha [L, H, W], rgb [L, 3, H, W], maps [L, H, W] disparities, near -> far; covered [H, W]:
    whether any view covers the farthest layer, the background, whose alpha is then 1."""
    transmittance = torch.ones_like(alpha[0])
    weights = []
    last = len(alpha) - 1
    for k in range(len(alpha)):
        opacity = torch.where(covered, torch.ones_like(alpha[k]), alpha[k]) if k == last else alpha[k]
        weights.append(transmittance * opacity)
        transmittance = transmittance * (1 - opacity)
    weights = torch.stack(weights)
    return Composited((weights[:, None] * rgb).sum(0), (weights * maps).sum(0), transmittance, weights)


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
