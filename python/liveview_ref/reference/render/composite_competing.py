"""Competing planes: a pixel's weights are the softmax of scale times logit 0 over the planes that
cover it. A plane's opacity depends on all the others, so that faint false surfaces cannot
accumulate into haze.

The result is still an MPI: the alphas of `alphas_of` give the same picture by the front-to-back
composite. Not in the paper.
"""

import torch
from torch import Tensor

from ..composite import Composited


def composite_competing(logit: Tensor, rgb: Tensor, covered: Tensor, maps: Tensor, scale: float = 1.0) -> Composited:
    """logit [L, H, W] (the network's channel 0), rgb [L, 3, H, W], covered [L, H, W] bool (whether
    any view covers the layer there), maps [L, H, W] disparities, layers in any order. A pixel that
    no layer covers stays empty: colour, disparity and weights 0, transmittance 1.
    Differentiable."""
    weights = competing_weights(logit, covered, scale)
    empty = (~covered).all(0).to(rgb)
    return Composited((weights[:, None] * rgb).sum(0), (weights * maps).sum(0), empty, weights)


def competing_weights(logit: Tensor, covered: Tensor, scale: float = 1.0) -> Tensor:
    """Softmax over the layers that cover a pixel, [L, H, W]; zeros where none does. Infinite logits
    count as the largest finite one of their sign (a NaN stays NaN); the scale is applied to
    differences, which cannot overflow."""
    limits = torch.finfo(logit.dtype)
    finite = logit.clamp(limits.min / 4, limits.max / 4).masked_fill(~covered, -torch.inf)
    top = finite.amax(0, keepdim=True)
    top = top.masked_fill(torch.isinf(top), 0.0).detach()  # the same shift of every logit: no gradient
    weights = torch.exp((finite - top) * scale)
    total = weights.sum(0, keepdim=True)
    return weights / torch.where(total > 0, total, torch.ones_like(total))


def best_layer(logit: Tensor, covered: Tensor) -> Tensor:
    """Index of the covered layer of the largest weight (ties: the first) per pixel [H, W]; -1 where
    no layer covers it. Compares logits, because weights far below the largest all round to 0."""
    limits = torch.finfo(logit.dtype)
    rank = logit.clamp(limits.min, limits.max).masked_fill(~covered, -torch.inf)
    first = (rank == rank.amax(0)).int().argmax(0)
    return torch.where(covered.any(0), first, -1)


def alphas_of(weights: Tensor) -> Tensor:
    """Alpha of each layer, [L, H, W], near -> far, that gives these weights in the front-to-back
    composite: alpha_k = w_k / (1 - sum of the nearer ones) = w_k / (sum of this one and the farther
    ones); 0 where nothing is left."""
    behind = weights.flip(0).cumsum(0).flip(0)
    return weights / torch.where(behind > 0, behind, torch.ones_like(behind))
