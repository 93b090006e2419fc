"""Matching cost with a photo as reference: the difference between the photo and its neighbours,
warped onto a plane or a band of planes.

Per neighbour and cell, with e the difference of the two colours: 0.5 min(mean |e|, 0.15) + 1.5
min(mean |grad e|, 0.05); grad e are the differences, summed over the channels, to the cells on the
right and below, each at its own k-th candidate, and 0 towards an unseen cell. An unseen cell costs
0.15, the maximum. The cost of a candidate is the mean of its two least costs over the neighbours.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from liveview_ref.reference.geometry.camera import Camera
from liveview_ref.reference.warp import warp_maps

from .grid import Candidates, Grid
from .tile_ranges import is_searched

UNITS_PER_COST = 32768  # units of the cost volume per unit of colour
COLOUR = 0.5, 0.15  # weight and bound of the difference of colour
GRADIENT = 1.5, 0.05  # weight and bound of the difference of gradient
UNSEEN_COST = COLOUR[0] * COLOUR[1] + GRADIENT[0] * GRADIENT[1]
BEST_NEIGHBOURS = 2  # neighbours whose costs are averaged: those that match best


def costs(
    photo: Tensor,
    camera: Camera,
    neighbours: list[tuple[Tensor, Camera]],
    grid: Grid,
    candidates: Candidates,
    cell: int,
    ranges: Tensor | None = None,
) -> Tensor:
    """Costs [n, h, w] int64 of the candidates, in units of 1/32768 (halves to even). `photo` and
    `neighbours` are shrunk by `cell`; their cameras are those of the full size. With `ranges`
    (tile_ranges.py), planes outside cost what an unseen cell costs."""
    disparity = grid.disparity(candidates.index.to(photo.dtype))
    each = torch.stack([neighbour_cost(photo, camera, *n, disparity, cell) for n in neighbours])
    least = each.sort(0).values[:BEST_NEIGHBOURS]
    total = least[0] + least[1] if len(least) > 1 else least[0]
    found = (total * (UNITS_PER_COST / len(least))).round().long()
    if ranges is None:
        return found
    return torch.where(is_searched(ranges, len(found), found.shape[1:]), found, round(UNSEEN_COST * UNITS_PER_COST))


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
    return torch.where(seen, cost, UNSEEN_COST)
