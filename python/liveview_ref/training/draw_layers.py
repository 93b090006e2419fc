"""Which layers gradients are taken through, where all would cost too much."""

import numpy as np
import torch
from torch import Tensor

EVEN = 0.15  # of the chance to be drawn


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
