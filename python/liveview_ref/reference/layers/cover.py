"""Selection among competing planes: the subset nearest to the best plane of every pixel. Not
in the paper."""

from bisect import bisect_right
from itertools import accumulate

from torch import Tensor

from .histogram import select_planes


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
