"""A random choice of the layers that gradients pass through, where all would take too long."""

import numpy as np
import torch
from torch import Tensor

EVEN = 0.15  # share of the probability that is the same for all layers


def draw_layers(mass: Tensor, count: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """`count` of the L layers, and the probability [count] with which each was drawn: a share EVEN
    is uniform, the rest proportional to the layers' mass [L], the size of their gradients.
    Systematic sampling: each layer at most once."""
    layers = len(mass)
    if count >= layers:
        return torch.arange(layers), torch.ones(layers)
    even = np.full(layers, 1 / layers)
    share = mass.double().numpy()
    share = share / share.sum() if share.sum() > 0 else even
    chance = count * (EVEN * even + (1 - EVEN) * share)
    while (chance > 1).any():  # certain layers are drawn once; the others share the remaining draws
        certain = chance >= 1
        left = count - certain.sum()
        chance = np.where(certain, 1.0, chance * left / chance[~certain].sum())
    order = rng.permutation(layers)
    edges = np.concatenate([[0.0], chance[order].cumsum()])
    at = np.minimum(rng.random() + np.arange(count), edges[-1] - 1e-9)
    ids = np.sort(order[np.searchsorted(edges, at, side="right") - 1])
    return torch.from_numpy(ids), torch.from_numpy(chance[ids]).float()
