"""The weights of the views in a layer's colour, and the share of the views that truly
see the surface."""

import torch
from torch import Tensor

from ..data.visibility import HIDDEN, SEEN
from ..reference.liveview import distance_bias


def view_weights(logits: Tensor, coverage: Tensor, distances: Tensor, power: float = 1.0) -> Tensor:
    """The weights by which the blend mixes the views that cover a pixel, [L, V, H, W], summing to
    1; weights are not reduced by partial coverage. Meaningless where no view covers the pixel.
    Arguments as in `blend`."""
    scores = torch.cat([torch.zeros_like(logits[:, :1]), logits[:, 1:]], 1)
    scores = scores + distance_bias(distances, power)[0].float()[:, None, None]
    return torch.softmax(scores.masked_fill(coverage <= 0, -1e4), 1)


def weight_on_seen(weights: Tensor, seen: Tensor) -> Tensor:
    """View weights [V, H, W] -> the share [H, W] of seen views in the weight of seen
    and hidden views."""
    right = (weights * (seen == SEEN)).sum(0)
    wrong = (weights * (seen == HIDDEN)).sum(0)
    return right / (right + wrong).clamp(min=1e-12)
