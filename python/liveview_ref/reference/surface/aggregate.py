"""Semi-global aggregation of a photo's matching costs (Hirschmueller, 2008): four paths, whose
penalty of a jump is lower at the photo's edges. In integers, except for the penalties before they
are rounded, and the parabola."""

import torch
from torch import Tensor

from .photo_sweep import UNITS_PER_COST, Candidates

STEP_PENALTY = 0.01  # P1, of a step to the next index, in units of colour
JUMP_PENALTY = 0.12  # P2, of a jump to any other, where the photo is of one colour
HALVING_EDGE = 0.05  # difference of colour that halves P2


def step_penalty() -> int:
    """P1 in units of the cost volume."""
    return int(STEP_PENALTY * UNITS_PER_COST + 0.5)


def jump_penalties(photo: Tensor) -> tuple[Tensor, Tensor]:
    """P2 in units of the cost volume for a path from the cell on the left [h, w - 1] and from the
    one above [h - 1, w], int64."""

    def penalty(difference: Tensor) -> Tensor:
        r, g, b = difference.abs()
        # A number divided by a tensor is its product with the reciprocal: rounded twice.
        jump = torch.full_like(r, JUMP_PENALTY) / (1 + (((r + g) + b) / 3) / HALVING_EDGE)
        units = jump.clamp(min=1.01 * STEP_PENALTY) * UNITS_PER_COST
        return (units.floor() + (units.frac() >= 0.5)).long()

    return penalty(photo[:, :, 1:] - photo[:, :, :-1]), penalty(photo[:, 1:] - photo[:, :-1])


INFINITE = 1 << 20  # above every sum of a path


def aggregate(costs: Tensor, photo: Tensor, candidates: Candidates) -> Tensor:
    """The index of least aggregated cost at each cell [h, w], moved between grid indices by a
    parabola, from costs [n, h, w] int64."""
    across, down = jump_penalties(photo)
    step = step_penalty()
    columns = Candidates(*(x.transpose(1, 2) for x in candidates))
    sums = both_ways(costs, candidates, down, step)
    sums = sums + both_ways(costs.transpose(1, 2), columns, across.T, step).transpose(1, 2)
    return winner(sums, candidates).to(photo.dtype) + shift(sums, candidates, photo.dtype)


def both_ways(costs: Tensor, candidates: Candidates, jump: Tensor, step: int) -> Tensor:
    """Sum of the paths along dimension 1 in both directions."""
    back = Candidates(*(x.flip(1) for x in candidates))
    return path(costs, candidates, jump, step) + path(costs.flip(1), back, jump.flip(0), step).flip(1)


def path(costs: Tensor, candidates: Candidates, jump: Tensor, step: int) -> Tensor:
    """L [n, h, w] of the path along dimension 1: L(d) = C(d) + min(L'(d), L'(d - 1) + P1, L'(d + 1)
    + P1, m + P2) - m. An index that the previous cell does not have is infinite there."""
    costs = torch.where(candidates.there, costs, INFINITE)
    last = int(candidates.index.max())
    # Indices that a cell lacks go behind all others.
    place = torch.where(candidates.there, candidates.index, last + 1) + 1
    by_index = torch.empty((last + 4, costs.shape[2]), dtype=torch.int64)
    before = costs[:, 0]
    found = [before]
    for y in range(1, costs.shape[1]):
        by_index.fill_(INFINITE).scatter_(0, place[:, y - 1], before)
        by_index[last + 2] = INFINITE
        best = before.amin(0)
        at = place[:, y]
        beside = torch.minimum(by_index.gather(0, at - 1), by_index.gather(0, at + 1)) + step
        cheapest = torch.minimum(torch.minimum(by_index.gather(0, at), beside), best + jump[y - 1])
        before = (costs[:, y] + (cheapest - best)).clamp(max=INFINITE)
        found.append(before)
    return torch.stack(found, 1)


def position(sums: Tensor, candidates: Candidates) -> Tensor:
    """Position of the least sum among the candidates, [1, h, w] (ties: the nearer)."""
    sums = torch.where(candidates.wins, sums, 4 * INFINITE)
    places = torch.arange(len(sums))[:, None, None]
    return torch.where(sums == sums.amin(0), places, len(sums)).amin(0, keepdim=True)


def winner(sums: Tensor, candidates: Candidates) -> Tensor:
    """Index of the least sum [h, w]."""
    return candidates.index.gather(0, position(sums, candidates))[0]


def shift(sums: Tensor, candidates: Candidates, dtype: torch.dtype) -> Tensor:
    """Offset from the winner to the vertex of the parabola through its sum and those of its
    neighbours, where both are candidates; else 0."""
    here = position(sums, candidates)
    before, after = (here - 1).clamp(min=0), (here + 1).clamp(max=len(sums) - 1)
    may = candidates.wins
    inner = (before < here) & (here < after) & may.gather(0, before) & may.gather(0, after)
    index = candidates.index
    inner &= (index.gather(0, after) - index.gather(0, here) == 1) & (
        index.gather(0, here) - index.gather(0, before) == 1
    )
    nearer, own, farther = (sums.gather(0, k).to(dtype) for k in (before, here, after))
    curvature = nearer - 2 * own + farther
    inner &= curvature > 0
    return torch.where(inner, 0.5 * (nearer - farther) / torch.where(inner, curvature, 1), 0)[0]
