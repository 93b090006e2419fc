"""Penalties of the aggregation for a change of index along a path: P1 and P2
of semi-global matching."""

import torch
from torch import Tensor

from .photo_sweep import UNITS_PER_COST

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
