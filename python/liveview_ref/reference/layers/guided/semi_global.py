"""Semi-global matching (Hirschmueller, 2008): costs of planes aggregated along image rows and
columns, four paths."""

import torch
from torch import Tensor

# Penalties of a move to the next plane and to any other, in units of the cost (a variance of
# colours in [0, 1]), in the guided search.
STEP_PENALTY = 0.004
JUMP_PENALTY = 0.1


def semi_global(costs: Tensor, step: float = STEP_PENALTY, jump: float = JUMP_PENALTY) -> Tensor:
    """Aggregated costs [D, h, w] -> [D, h, w]: the sum over four directions (down, up, right, left)
    of the cheapest path that ends in each cell and plane."""
    columns = costs.transpose(1, 2)
    vertical = scan(costs, step, jump) + scan(costs.flip(1), step, jump).flip(1)
    horizontal = scan(columns, step, jump) + scan(columns.flip(1), step, jump).flip(1)
    return vertical + horizontal.transpose(1, 2)


def scan(costs: Tensor, step: float, jump: float) -> Tensor:
    """One direction, along dimension 1: the cost here, plus the cheapest of staying on the plane,
    stepping to the next and jumping to any other, less the cheapest before (which keeps the sums
    small and changes no comparison)."""
    before = costs[:, 0]
    total = [before]
    edge = torch.full_like(before[:1], torch.inf)
    for cost in costs.unbind(1)[1:]:
        best = before.amin(0)
        beside = torch.minimum(torch.cat([before[1:], edge]), torch.cat([edge, before[:-1]])) + step
        before = cost + (torch.minimum(torch.minimum(before, beside), best + jump) - best)
        total.append(before)
    return torch.stack(total, 1)
