"""Planes where the scene is: 1-D k-means over the disparities that the coarse pass finds."""

import numpy as np

BINS = 512  # of k-means: far finer than planes are apart


def kmeans_planes(disparities: np.ndarray, count: int) -> list[float]:
    """The `count` planes (1/scene unit, near -> far) whose sum of squared distances to the disparities is least: exact
    over a histogram, by dynamic programming over where each cluster begins (Ckmeans.1d.dp). Fewer where fewer bins hold
    anything; values that are not finite are left out."""
    values = disparities[np.isfinite(disparities)].astype(np.float64).ravel()
    if not len(values):
        return []
    low, high = values.min(), values.max()
    part = (values - low) / (high - low) if high > low else np.zeros_like(values)
    bins = np.minimum((part * BINS).astype(int), BINS - 1)
    x = values - low
    moments = np.stack([np.bincount(bins, term, BINS) for term in (np.ones_like(x), x, x * x)])
    sums = np.pad(moments[:, moments[0] > 0].cumsum(1), ((0, 0), (1, 0)))  # [3, bins that hold anything + 1]
    filled = sums.shape[1] - 1

    def spread(start: np.ndarray | int, end: int) -> np.ndarray:
        weight, first, second = sums[:, end, None] - sums[:, np.atleast_1d(start)]
        return np.maximum(second - first * first / weight, 0)

    least = np.array([0.0, *(spread(0, end)[0] for end in range(1, filled + 1))])
    begins = [np.zeros(filled + 1, int)]
    for clusters in range(1, min(count, filled)):
        row, begin = np.full(filled + 1, np.inf), np.zeros(filled + 1, int)
        for end in range(clusters + 1, filled + 1):
            starts = np.arange(clusters, end)
            costs = least[starts] + spread(starts, end)
            begin[end] = starts[costs.argmin()]
            row[end] = costs.min()
        least = row
        begins.append(begin)
    planes, end = [], filled
    for begin in reversed(begins):
        weight, first, _ = sums[:, end] - sums[:, begin[end]]
        planes.append(float(low + first / weight))
        end = begin[end]
    return planes
