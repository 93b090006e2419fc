"""Pixels of warp, blend and composites in 50 decimal digits, to check the float64
truth of stability.py.

Written directly from the formulas of the paper, one pixel at a time; arrays are numpy, as
stability.py reads them.
"""

import numpy as np
from mpmath import exp, floor, inverse, log, matrix, mp, mpf

mp.dps = 50
ZERO = mpf(0)


def exact(array: np.ndarray) -> matrix:
    """A numpy vector or matrix, without rounding."""
    return matrix(array.tolist())


def warp(data: dict[str, np.ndarray], pixel: int) -> list[mpf]:
    """RGB and coverage of a target pixel."""
    width = int(data["target.size"][0])
    k, rotation, translation = (exact(data[f"view0.{part}"]) for part in ("k", "rotation", "translation"))
    k_target, rotation_target, translation_target = (
        exact(data[f"target.{part}"]) for part in ("k", "rotation", "translation")
    )
    relative = rotation * rotation_target.T
    ray = inverse(k_target) * matrix([pixel % width + mpf(0.5), pixel // width + mpf(0.5), 1])
    disparity = mpf(float(data["disparities"][0]))
    u, v, w = k * (relative * ray + disparity * (translation - relative * translation_target))
    return bilinear(data["view0.image"], u / w, v / w) if w > 0 else [ZERO] * 4


def bilinear(image: np.ndarray, x: mpf, y: mpf) -> list[mpf]:
    height, width, _ = image.shape
    left, top = floor(x - 0.5), floor(y - 0.5)
    across, down = x - 0.5 - left, y - 0.5 - top
    total = [ZERO] * 4
    for column, row, weight in (
        (left, top, (1 - across) * (1 - down)),
        (left + 1, top, across * (1 - down)),
        (left, top + 1, (1 - across) * down),
        (left + 1, top + 1, across * down),
    ):
        if 0 <= column < width and 0 <= row < height:
            colour = [mpf(float(c)) for c in image[int(row), int(column)]]
            total = [sum + weight * value for sum, value in zip(total, [*colour, mpf(1)], strict=True)]
    return total


def blend(data: dict[str, np.ndarray], pixel: int) -> list[mpf]:
    """Alpha and RGB of a pixel. Infinite logits count as the largest finite ones of their sign."""
    largest = float(np.finfo(np.float32).max)
    logits = [mpf(float(x)) for x in np.clip(data["logits"][:, pixel], -largest, largest)]
    coverage = [mpf(float(x)) for x in data["coverage"][:, pixel]]
    distances = [mpf(float(x)) for x in data["distances"]]
    seen = [view for view, c in enumerate(coverage) if c > 0]
    if not seen:
        return [ZERO] * 4
    counted = [view for view in seen if distances[view] == 0] or seen
    scores = {v: (logits[v] if v else ZERO) - (log(distances[v]) if distances[v] else ZERO) for v in counted}
    weights = {view: exp(score - max(scores.values())) for view, score in scores.items()}
    total = sum(weight * coverage[view] for view, weight in weights.items())
    colour = data["colour"][:, pixel].reshape(-1, 3)
    rgb = [sum(w * mpf(float(colour[view, c])) for view, w in weights.items()) / total for c in range(3)]
    return [1 / (1 + exp(-logits[0])), *rgb]


def composite(data: dict[str, np.ndarray], pixel: int) -> list[mpf]:
    """RGB, disparity and transmittance of a pixel."""
    through, total = mpf(1), [ZERO] * 4
    last = len(data["alpha"]) - 1
    for layer in range(last + 1):
        opaque = layer == last and data["background"][0]
        alpha = mpf(1) if opaque else mpf(float(data["alpha"][layer, pixel]))
        values = [*data["rgb"][layer, :, pixel], data["maps"][layer, pixel]]
        total = [sum + through * alpha * mpf(float(value)) for sum, value in zip(total, values, strict=True)]
        through *= 1 - alpha
    return [*total, through]


def composite_competing(data: dict[str, np.ndarray], pixel: int) -> list[mpf]:
    """RGB, disparity and transmittance of a pixel of competing layers. Infinite logits count as the
    largest finite ones of their sign, NaN as the least."""
    largest = float(np.finfo(np.float32).max)
    covered = np.flatnonzero(data["covered"][:, pixel])
    if not len(covered):
        return [ZERO] * 4 + [mpf(1)]
    finite = np.clip(np.nan_to_num(data["logits"][covered, pixel], nan=-largest), -largest, largest)
    scores = [mpf(float(data["alpha_scale"][0])) * mpf(float(logit)) for logit in finite]
    weights = [exp(score - max(scores)) for score in scores]
    values = np.concatenate([data["rgb"][covered, :, pixel], data["maps"][covered, None, pixel]], 1)
    means = [sum(w * mpf(float(x)) for w, x in zip(weights, column, strict=True)) / sum(weights) for column in values.T]
    return [*means, ZERO]
