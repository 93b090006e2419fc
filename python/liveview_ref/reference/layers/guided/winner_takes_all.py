"""Winner takes all: the disparity of least cost at each cell."""

import torch
from torch import Tensor


def winner_takes_all(costs: Tensor, maps: Tensor) -> Tensor:
    """Disparity [h, w] of the cheapest of the layers [D, h, w], moved to the vertex of the parabola
    through its cost and its neighbours' (ties: the nearer layer; the first and the last layer are
    not moved)."""
    index = costs.argmin(0, keepdim=True)
    before, after = (index - 1).clamp(min=0), (index + 1).clamp(max=len(costs) - 1)
    nearer, here, farther = (costs.gather(0, i)[0] for i in (before, index, after))
    curvature = nearer - 2 * here + farther
    inner = ((before < index) & (index < after))[0] & (curvature > 0)
    move = torch.where(inner, 0.5 * (nearer - farther) / torch.where(inner, curvature, 1.0), 0.0)
    towards = maps.gather(0, torch.where(move > 0, after[0], before[0])[None])[0]
    own = maps.gather(0, index)[0]
    return own + move.abs() * (towards - own)
