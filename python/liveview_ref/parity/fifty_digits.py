"""Pixels of warp, blend and composites in 50 decimal digits, to check the float64 truth of
stability/.

Written directly from the formulas of the paper, one pixel at a time; arrays are numpy.
"""

from collections.abc import Iterable

import numpy as np
from mpmath import exp, floor, inverse, log, matrix, mp, mpf

from ..reference.liveview import Camera

mp.dps = 50
ZERO = mpf(0)
LARGEST = float(np.finfo(np.float32).max)


def exact(array: Iterable[float]) -> list[mpf]:
    """Numbers without rounding."""
    return [mpf(float(x)) for x in array]


def parts_of(camera: Camera) -> list[matrix]:
    return [matrix(part.tolist()) for part in (camera.k, camera.rotation, camera.translation)]


def warp(photo: np.ndarray, source: Camera, target: Camera, disparity: float, pixel: int) -> list[mpf]:
    """RGB and coverage of a target pixel; photo [3, h, w]."""
    k, rotation, translation = parts_of(source)
    k_target, rotation_target, translation_target = parts_of(target)
    relative = rotation * rotation_target.T
    ray = inverse(k_target) * matrix([pixel % target.width + mpf(0.5), pixel // target.width + mpf(0.5), 1])
    u, v, w = k * (relative * ray + mpf(disparity) * (translation - relative * translation_target))
    return bilinear(photo, u / w, v / w) if w > 0 else [ZERO] * 4


def bilinear(photo: np.ndarray, x: mpf, y: mpf) -> list[mpf]:
    _, height, width = photo.shape
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
            colour = exact(photo[:, int(row), int(column)])
            total = [sum + weight * value for sum, value in zip(total, [*colour, mpf(1)], strict=True)]
    return total


def blend(logits: np.ndarray, colour: np.ndarray, coverage: np.ndarray, distances: np.ndarray) -> list[mpf]:
    """Alpha and RGB of a pixel: logits, coverage and distances [V], colour [V, 3]. Infinite logits
    count as the largest finite ones of their sign."""
    logits, coverage, distances = exact(np.clip(logits, -LARGEST, LARGEST)), exact(coverage), exact(distances)
    seen = [view for view, c in enumerate(coverage) if c > 0]
    if not seen:
        return [ZERO] * 4
    counted = [view for view in seen if distances[view] == 0] or seen
    scores = {v: (logits[v] if v else ZERO) - (log(distances[v]) if distances[v] else ZERO) for v in counted}
    top = max(scores.values())
    weights = {view: exp(score - top) for view, score in scores.items()}
    total = sum(weight * coverage[view] for view, weight in weights.items())
    rgb = [sum(w * mpf(float(colour[view, c])) for view, w in weights.items()) / total for c in range(3)]
    return [1 / (1 + exp(-logits[0])), *rgb]


def composite(alpha: np.ndarray, rgb: np.ndarray, maps: np.ndarray, background: bool) -> list[mpf]:
    """RGB, disparity and transmittance of a pixel: alpha and maps [L], rgb [L, 3]."""
    through, total = mpf(1), [ZERO] * 4
    for layer, opacity in enumerate(exact(alpha)):
        opacity = mpf(1) if background and layer == len(alpha) - 1 else opacity
        values = exact([*rgb[layer], maps[layer]])
        total = [sum + through * opacity * value for sum, value in zip(total, values, strict=True)]
        through *= 1 - opacity
    return [*total, through]


def composite_competing(
    logit: np.ndarray, rgb: np.ndarray, covered: np.ndarray, maps: np.ndarray, scale: float
) -> list[mpf]:
    """RGB, disparity and transmittance of a pixel of competing layers: logit, covered and maps [L],
    rgb [L, 3]. Infinite logits count as the largest finite ones of their sign, NaN as the least."""
    if not covered.any():
        return [ZERO] * 4 + [mpf(1)]
    scores = exact(np.clip(np.nan_to_num(logit[covered], nan=-LARGEST), -LARGEST, LARGEST))
    top = max(scores)
    weights = [exp(mpf(scale) * (score - top)) for score in scores]
    total = sum(weights)
    values = np.concatenate([rgb[covered], maps[covered, None]], 1)
    means = [sum(w * x for w, x in zip(weights, exact(column), strict=True)) / total for column in values.T]
    return [*means, ZERO]
