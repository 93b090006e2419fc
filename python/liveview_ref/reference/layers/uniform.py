"""Planes evenly spaced in disparity (the paper's)."""

import torch
from torch import Tensor


def uniform_disparities(near: float, far: float, count: int) -> Tensor:
    """`count` disparities, evenly spaced in 1/z from 1/near to 1/far, near -> far, [D] float64.
    `far` may be inf."""
    if count == 1:
        return torch.tensor([0.5 / near + 0.5 / far], dtype=torch.float64)
    step = torch.arange(count, dtype=torch.float64) / (count - 1)
    return 1.0 / near + step * (1.0 / far - 1.0 / near)
