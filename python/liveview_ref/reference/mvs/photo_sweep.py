"""Matching cost with a photo as reference: how far its neighbours, warped onto a plane or a band of planes, are from
it.

Per neighbour and cell, with e the difference of the two colours: 0.5 min(mean |e|, 0.15) + 1.5 min(mean |grad e|,
0.05); grad e are the differences, summed over the channels, to the cells on the right and below, each at its own k-th
candidate, 0 towards a cell that is not seen. Averaged over the seen cells of a window, 0.15 where not more than a fifth
of it is seen. Over the neighbours the mean of the better half, rounded up, of 8 at most.
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
SHARE = 0.2  # seen cells of a window, as a share of all, above which it is believed
KEPT = 4  # most neighbours whose costs are kept


def costs(
    photo: Tensor,
    camera: Camera,
    neighbours: list[tuple[Tensor, Camera]],
    grid: Grid,
    candidates: Candidates,
    cell: int,
    radius: int,
) -> Tensor:
    """Costs [n, h, w] int64 of the candidates, in units of 1/32768 (halves to even). `photo` and `neighbours` are
    shrunk by `cell`, their cameras are not."""
    disparity = grid.disparity(candidates.index.to(photo.dtype))
    means = torch.stack([neighbour_cost(photo, camera, *n, disparity, cell, radius) for n in neighbours])
    kept = min(-(-len(neighbours) // 2), KEPT)
    least = means.sort(0).values[:kept]
    total = least[0]
    for cost in least[1:]:
        total = total + cost
    return (total * (UNIT / kept)).round().long()


def neighbour_cost(
    photo: Tensor, camera: Camera, image: Tensor, source: Camera, disparity: Tensor, cell: int, radius: int
):
    """One neighbour's cost [n, h, w], in units of colour."""
    colour, coverage = warp_maps(image, source, camera, disparity, cell)
    seen = coverage > 0.5
    share = seen.to(photo.dtype) / torch.where(seen, coverage, 1)
    e = (colour * share[:, None] - photo * seen[:, None]).unbind(1)
    seen = seen.to(photo.dtype)
    difference, signed = (e[0].abs() + e[1].abs()) + e[2].abs(), (e[0] + e[1]) + e[2]
    right = (signed[..., 1:] - signed[..., :-1]).abs() * seen[..., 1:]
    down = (signed[:, 1:] - signed[:, :-1]).abs() * seen[:, 1:]
    gradient = (F.pad(right, (0, 1)) + F.pad(down, (0, 0, 0, 1))) * (1 / 6)
    cost = COLOUR[0] * (difference * (1 / 3)).clamp(max=COLOUR[1]) + GRADIENT[0] * gradient.clamp(max=GRADIENT[1])
    number = window_sum(seen, radius)
    enough = number > SHARE * (2 * radius + 1) ** 2
    return torch.where(enough, window_sum(cost * seen, radius) / torch.where(enough, number, 1), UNSEEN)


def window_sum(x: Tensor, radius: int) -> Tensor:
    """Sum over windows of (2 radius + 1)^2 cells, row by row, from above and from the left."""
    height, width = x.shape[-2:]
    padded = F.pad(x, (radius,) * 4)
    rows = sum(padded[..., i : i + height, :] for i in range(2 * radius + 1))
    return sum(rows[..., i : i + width] for i in range(2 * radius + 1))
