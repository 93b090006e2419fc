"""Planes that compete (design: "Competing planes"): a pixel's weights are the softmax over the planes that cover it of
scale times logit 0, so that no plane is judged alone and false opacity cannot add up to fog.

Still an MPI: the alphas of `alphas_of` give the same picture by the front-to-back composite. Not in the paper.
"""

import numpy as np
import torch
from torch import Tensor

from .composite import Composited


def compete(logit: Tensor, rgb: Tensor, covered: Tensor, maps: Tensor, scale: float = 1.0) -> Composited:
    """logit [L, H, W] (the network's channel 0), rgb [L, 3, H, W], covered [L, H, W] bool (whether any view sees the
    layer there), maps [L, H, W] disparities, layers in any order. A pixel that no layer covers stays empty: colour,
    disparity and weights 0, transmittance 1. Differentiable."""
    weights = competing_weights(logit, covered, scale)
    empty = (~covered).all(0).to(rgb)
    return Composited((weights[:, None] * rgb).sum(0), (weights * maps).sum(0), empty, weights)


def competing_weights(logit: Tensor, covered: Tensor, scale: float = 1.0) -> Tensor:
    """Softmax over the layers that cover a pixel, [L, H, W]; zeros where none does. Infinite logits are as the largest
    finite one of their sign (a NaN stays one), and the scale is applied to differences, which no overflow reaches."""
    limits = torch.finfo(logit.dtype)
    finite = logit.clamp(limits.min / 4, limits.max / 4).masked_fill(~covered, -torch.inf)
    top = finite.amax(0, keepdim=True)
    top = top.masked_fill(torch.isinf(top), 0.0).detach()  # shifts every logit alike: no gradient of its own
    weights = torch.exp((finite - top) * scale)
    total = weights.sum(0, keepdim=True)
    return weights / torch.where(total > 0, total, torch.ones_like(total))


def alphas_of(weights: Tensor) -> Tensor:
    """Alpha of each layer, [L, H, W], near -> far, such that front to back they have these weights: alpha_k =
    w_k / (1 - sum of the nearer ones) = w_k / (sum of this one and the farther ones); 0 where nothing is left."""
    behind = weights.flip(0).cumsum(0).flip(0)
    return weights / torch.where(behind > 0, behind, torch.ones_like(behind))


EVEN = 0.15


def draw_layers(mass: Tensor, count: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """`count` of the L layers to take gradients through, and the chance [count] with which each was drawn: EVEN of the
    chance is shared evenly, the rest goes by the layers' mass [L], the size of their gradients. Systematic sampling:
    each layer at most once."""
    layers = len(mass)
    if count >= layers:
        return torch.arange(layers), torch.ones(layers)
    even = np.full(layers, 1 / layers)
    share = mass.double().numpy()
    share = share / share.sum() if share.sum() > 0 else even
    chance = count * (EVEN * even + (1 - EVEN) * share)
    while (chance > 1).any():  # what is certain is drawn once; the rest shares what is left
        certain = chance >= 1
        left = count - certain.sum()
        chance = np.where(certain, 1.0, chance * left / chance[~certain].sum())
    order = rng.permutation(layers)
    edges = np.concatenate([[0.0], chance[order].cumsum()])
    at = np.minimum(rng.random() + np.arange(count), edges[-1] - 1e-9)
    ids = np.sort(order[np.searchsorted(edges, at, side="right") - 1])
    return torch.from_numpy(ids), torch.from_numpy(chance[ids]).float()
