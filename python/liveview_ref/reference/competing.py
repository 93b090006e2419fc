"""Competing planes, not in the paper: a pixel's weights are the softmax of scale times logit 0 over
the planes that cover it. A plane's opacity depends on all the others, so that faint false surfaces
cannot accumulate into haze.

The result is still an MPI: the alphas of `alphas_of` give the same picture by the front-to-back
composite. Their selection is the subset nearest to the best plane of every pixel.
"""

from bisect import bisect_right
from itertools import accumulate

import torch
from torch import Tensor

from .liveview import Composited, select_planes


def composite_competing(logit: Tensor, rgb: Tensor, covered: Tensor, maps: Tensor, scale: float = 1.0) -> Composited:
    """logit [L, H, W] (the network's channel 0), rgb [L, 3, H, W], covered [L, H, W] bool (whether
    any view covers the layer there), maps [L, H, W] disparities, layers in any order. A pixel that
    no layer covers stays empty: colour, disparity and weights 0, transmittance 1.
    Differentiable."""
    weights = competing_weights(logit, covered, scale)
    empty = (~covered).all(0).to(rgb)
    return Composited((weights[:, None] * rgb).sum(0), (weights * maps).sum(0), empty, weights)


def competing_weights(logit: Tensor, covered: Tensor, scale: float = 1.0) -> Tensor:
    """Softmax over the layers that cover a pixel, [L, H, W]; zeros where none does. Infinite logits
    count as the largest finite one of their sign (a NaN stays NaN); the scale is applied to
    differences, which cannot overflow."""
    limits = torch.finfo(logit.dtype)
    finite = logit.clamp(limits.min / 4, limits.max / 4).masked_fill(~covered, -torch.inf)
    top = finite.amax(0, keepdim=True)
    top = top.masked_fill(torch.isinf(top), 0.0).detach()  # the same shift of every logit: no gradient
    weights = torch.exp((finite - top) * scale)
    total = weights.sum(0, keepdim=True)
    return weights / torch.where(total > 0, total, torch.ones_like(total))


def best_layer(logit: Tensor, covered: Tensor) -> Tensor:
    """Index of the covered layer of the largest weight (ties: the first) per pixel [H, W]; -1 where
    no layer covers it. Compares logits, because weights far below the largest all round to 0."""
    limits = torch.finfo(logit.dtype)
    rank = logit.clamp(limits.min, limits.max).masked_fill(~covered, -torch.inf)
    first = (rank == rank.amax(0)).int().argmax(0)
    return torch.where(covered.any(0), first, -1)


def alphas_of(weights: Tensor) -> Tensor:
    """Alpha of each layer, [L, H, W], near -> far, that gives these weights in the front-to-back
    composite: alpha_k = w_k / (1 - sum of the nearer ones) = w_k / (sum of this one and the farther
    ones); 0 where nothing is left."""
    behind = weights.flip(0).cumsum(0).flip(0)
    return weights / torch.where(behind > 0, behind, torch.ones_like(behind))


def cover_planes(histogram: Tensor, count: int) -> list[int]:
    """Indices, near -> far, of the `count` planes that minimise the sum over all pixels of the
    distance, counted in planes, from the pixel's best plane to the nearest selected one: weighted
    k-medians of the histogram, exact by dynamic programming over the filled bins (ties: the
    nearer). The fullest bins, as `select_planes` takes them, crowd at the depths that cover most
    pixels and leave other depths without a plane. With no more than `count` filled bins, the result
    is that of `select_planes`."""
    bins = [k for k, votes in enumerate(histogram.tolist()) if votes]
    if len(bins) <= count:
        return select_planes(histogram, count)
    votes = [int(histogram[k]) for k in bins]
    total = list(accumulate(votes, initial=0))
    moment = list(accumulate((v * k for v, k in zip(votes, bins, strict=True)), initial=0))

    def before(start: int, kept: int) -> int:
        """Weighted distances of the bins from `start` up to the kept one."""
        return bins[kept] * (total[kept] - total[start]) - (moment[kept] - moment[start])

    def after(kept: int, end: int) -> int:
        return moment[end] - moment[kept] - bins[kept] * (total[end] - total[kept])

    def between(a: int, b: int) -> int:
        middle = bisect_right(bins, (bins[a] + bins[b]) // 2)
        return after(a, middle) + before(middle, b)

    # least[b]: the least sum over the bins up to b if b is kept, with len(last) + 1 bins kept; a
    # row of `last` holds, for each b, the bin kept before it.
    least = [before(0, b) for b in range(len(bins))]
    last = []
    for kept in range(1, count):
        row = [min((least[a] + between(a, b), a) for a in range(kept - 1, b)) for b in range(kept, len(bins))]
        row = [(0, 0)] * kept + row  # never read
        last.append([a for _, a in row])
        least = [cost for cost, _ in row]
    chosen = [min(range(count - 1, len(bins)), key=lambda b: least[b] + after(b, len(bins)))]
    for row in reversed(last):
        chosen.append(row[chosen[-1]])
    return [bins[b] for b in reversed(chosen)]
