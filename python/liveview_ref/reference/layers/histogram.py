"""The paper's selection of planes: the K fullest bins of the histogram of each pixel's best
plane."""

import torch
from torch import Tensor


def plane_histogram(alpha: Tensor) -> Tensor:
    """alpha [D, H, W] from the network -> number of pixels per plane [D]: each pixel votes for the
    plane with its largest alpha (ties: the nearer); a pixel that no plane covers (all alpha 0) does
    not vote."""
    best = alpha.argmax(0)
    best = best[alpha.amax(0) > 0]
    return torch.bincount(best, minlength=len(alpha))


def select_planes(histogram: Tensor, count: int) -> list[int]:
    """Indices of the `count` fullest bins (ties: the nearer), near -> far; all planes if there are
    no more than `count`."""
    order = sorted(range(len(histogram)), key=lambda k: (-int(histogram[k]), k))
    return sorted(order[:count])
