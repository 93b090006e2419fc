"""True visibility of the target's surface in the views, from the disparity maps of
target and views; and how much of a blend's weight is on views that see it."""

import torch
import torch.nn.functional as F
from torch import Tensor

from ..reference.layers import normalised_grid, source_coordinates
from ..reference.liveview import Camera, PlaneSweep, distance_bias

HIDDEN, SEEN, UNKNOWN = 0, 1, 2
SAME, OTHER = 1.0, 2.0  # pixels of parallax within which it is the same surface, and beyond which a different one


def visibility(disparity: Tensor, target: Camera, maps: list[Tensor], cameras: list[Camera]) -> Tensor:
    """disparity [H, W] of the target and `maps` [Hs, Ws] of the views, each 1/z in its own camera
    -> [V, H, W] uint8.

    HIDDEN: all four pixels of the view around the point are nearer by more than OTHER pixels of
    parallax between this view and the target; SEEN: all are within SAME; otherwise, and outside the
    view, UNKNOWN."""
    result = torch.full((len(maps), *disparity.shape), UNKNOWN, dtype=torch.uint8)
    for v, (own, camera) in enumerate(zip(maps, cameras, strict=True)):
        sweep = PlaneSweep.of(camera, target)
        at, w = source_coordinates(sweep, disparity[None].double())
        expected = (disparity / w[0]).float()
        height, width = own.shape
        grid = normalised_grid(at, w, width, height).float()
        inside = (grid.abs() < 1 - 1.0 / min(height, width)).all(-1)[0]
        extremes = []
        # Extremes of the 2 x 2 pixels around the point: pooled, then the pool that contains all
        # four.
        for sign in (1.0, -1.0):
            pooled = F.max_pool2d(sign * own[None, None], 2, 1)
            x, y = ((grid[0, ..., 0] + 1) / 2 * width - 0.5).floor(), ((grid[0, ..., 1] + 1) / 2 * height - 0.5).floor()
            x, y = x.clamp(0, width - 2).long(), y.clamp(0, height - 2).long()
            extremes.append(sign * pooled[0, 0][y, x])
        nearest, farthest = extremes
        per_pixel = 1.0 / sweep.epipole[:2].norm().float().clamp(min=1e-9)  # disparity of a pixel, at w = 1
        same = (nearest - expected < SAME * per_pixel) & (expected - farthest < SAME * per_pixel)
        result[v][inside & same] = SEEN
        result[v][inside & (farthest - expected > OTHER * per_pixel)] = HIDDEN
    return result


def partly_hidden(seen: Tensor) -> Tensor:
    """Pixels of `visibility` [V, H, W] where some view is occluded and another sees the surface,
    [H, W] bool."""
    return (seen == HIDDEN).any(0) & (seen == SEEN).any(0)


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
