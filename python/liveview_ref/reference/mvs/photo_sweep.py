"""Matching cost with a photo as reference: how far its neighbours, warped onto a plane or a band of planes, are from
it.

Per neighbour and cell, with e the difference of the two colours: 0.5 min(mean |e|, 0.15) + 1.5 min(mean |grad e|,
0.05); grad e are the differences, summed over the channels, to the cells on the right and below, each at its own k-th
candidate, 0 towards a cell that is not seen. A cell that is not seen costs 0.15, the most there is. Over the
neighbours: the mean of the least two.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from ..camera import Camera
from ..warp import warp_maps
from .grid import Candidates, Grid

UNIT = 32768  # one unit of cost, in units of the volume
COLOUR = 0.5, 0.15  # weight and bound of the difference of colour
GRADIENT = 1.5, 0.05
UNSEEN = COLOUR[0] * COLOUR[1] + GRADIENT[0] * GRADIENT[1]
KEPT = 2  # neighbours whose costs count: those that match best


def costs(
    photo: Tensor,
    camera: Camera,
    neighbours: list[tuple[Tensor, Camera]],
    grid: Grid,
    candidates: Candidates,
    cell: int,
) -> Tensor:
    """Costs [n, h, w] int64 of the candidates, in units of 1/32768 (halves to even). `photo` and `neighbours` are
    shrunk by `cell`, their cameras are not."""
    disparity = grid.disparity(candidates.index.to(photo.dtype))
    each = torch.stack([neighbour_cost(photo, camera, *n, disparity, cell) for n in neighbours])
    least = each.sort(0).values[:KEPT]
    total = least[0] + least[1] if len(least) > 1 else least[0]
    return (total * (UNIT / len(least))).round().long()


def neighbour_cost(photo: Tensor, camera: Camera, image: Tensor, source: Camera, disparity: Tensor, cell: int):
    """One neighbour's cost [n, h, w], in units of colour."""
    colour, coverage = warp_maps(image, source, camera, disparity, cell)
    seen = coverage > 0.5
    share = seen.to(photo.dtype) / torch.where(seen, coverage, 1)
    e = (colour * share[:, None] - photo * seen[:, None]).unbind(1)
    difference, signed = (e[0].abs() + e[1].abs()) + e[2].abs(), (e[0] + e[1]) + e[2]
    right = (signed[..., 1:] - signed[..., :-1]).abs() * seen[..., 1:]
    down = (signed[:, 1:] - signed[:, :-1]).abs() * seen[:, 1:]
    gradient = (F.pad(right, (0, 1)) + F.pad(down, (0, 0, 0, 1))) * (1 / 6)
    cost = COLOUR[0] * (difference * (1 / 3)).clamp(max=COLOUR[1]) + GRADIENT[0] * gradient.clamp(max=GRADIENT[1])
    return torch.where(seen, cost, UNSEEN)
