"""Extreme cases of the blend: logits, distances and coverages over all decades of float32."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from ...extension import liveview
from ...reference import liveview as reference
from .. import fifty_digits
from .case import FLOAT32, Case, Inputs, Outputs, decades, exponent, units
from .onnx_graph import Graph

PIXELS = 301  # not a multiple of those that the blend computes together
BOUND = 1e-6  # of values in [0, 1], from rounded weights, products and quotients
DENORMAL_STEP = 1.4e-45  # coverages and colours near it have no significant digits


class Module(nn.Module):
    def forward(self, *inputs):
        return reference.blend(*inputs)


@functools.cache
def graph(views: int, coincident: bool) -> Graph:
    shapes = (1, views, 1, 7), (1, views, 3, 1, 7), (1, views, 1, 7)
    distances = np.arange(views, dtype=np.float32) + (0 if coincident else 1)
    inputs = *(np.full(shape, 0.5, np.float32) for shape in shapes), distances
    return Graph(Module(), inputs, {"input0": {3: "p"}, "input1": {4: "p"}, "input2": {3: "p"}})


def outputs(alpha, rgb) -> Outputs:
    return {"alpha": np.asarray(alpha)[0, 0], "rgb": np.asarray(rgb)[0, :, 0]}


@dataclass
class Blend(Inputs):
    """One layer, with the arguments of the stage: logits and coverage [1, V, 1, P], colour [1, V,
    3, 1, P], distances [V]."""

    stage = "blend"
    logits: np.ndarray
    colour: np.ndarray
    coverage: np.ndarray
    distances: np.ndarray

    @classmethod
    def ordinary(cls, distances: np.ndarray) -> "Blend":
        """All views cover all pixels, with ordinary logits."""
        views = len(distances)
        values = units(7, 4 * views * PIXELS)
        logits, colour = np.split(values, [views * PIXELS])
        logits = (8 * logits - 4).reshape(1, views, 1, PIXELS)
        return cls(logits, colour.reshape(1, views, 3, 1, PIXELS), np.ones_like(logits), distances.copy())

    def cover(self, view: int, coverage: Callable[[np.ndarray], np.ndarray]) -> "Blend":
        """Sets a view's coverage of each pixel, and multiplies its colour by it."""
        values = np.broadcast_to(coverage(np.arange(PIXELS)), PIXELS).astype(np.float32)
        self.coverage[0, view, 0] = values
        self.colour[0, view] *= values
        return self

    def arguments(self) -> tuple[np.ndarray, ...]:
        return self.logits, self.colour, self.coverage, self.distances

    def rust(self) -> Outputs:
        return outputs(*liveview.blend(*self.arguments()))

    def others(self) -> dict[str, Outputs]:
        *samples, distances = self.arguments()
        in_graph = graph(len(distances), bool((distances == 0).any()))(*samples, distances.astype(np.float32))
        in_torch = reference.blend(*map(torch.from_numpy, self.arguments()))
        return {"torch": outputs(*in_torch), "onnxruntime": outputs(*in_graph)}

    def truth(self) -> Outputs:
        # Infinite logits count as the largest finite one of their sign.
        logits = np.clip(self.logits[0, :, 0].astype(np.float64), FLOAT32.min, FLOAT32.max)
        coverage, colour = self.coverage[0, :, 0].astype(np.float64), self.colour[0, :, :, 0].astype(np.float64)
        covering = coverage > 0
        coincident = covering & (self.distances == 0)[:, None]
        counted = np.where(coincident.any(0), coincident, covering)
        scores = np.concatenate([np.zeros((1, PIXELS)), logits[1:]])  # of the softmax
        log_distance = np.log(np.where(self.distances > 0, self.distances, 1))[:, None]
        with np.errstate(over="ignore"):
            alpha = covering.any(0) / (1 + np.exp(-logits[0]))
            # By how much each view's score exceeds those of the others [V, V, P]. Logits and
            # logarithms of distances are kept separate: added to a large logit, the latter would be
            # lost even in float64.
            above = (scores[:, None] - scores) - (log_distance[:, None] - log_distance)
            below = np.where(counted, coverage * np.exp(np.where(counted, -above, 0)), 0).sum(1)
        weights = counted / np.where(counted, below, 1)
        return {"alpha": alpha, "rgb": (weights[:, None] * colour).sum(0)}

    def digits(self, pixel: int) -> list:
        samples = self.logits[0, :, 0], self.colour[0, :, :, 0], self.coverage[0, :, 0]
        return fifty_digits.blend(*(x[..., pixel] for x in samples), self.distances)


def families(distances: np.ndarray) -> list[list[Case]]:
    """From the distances of an ordinary rig. No distance is 0: that is a separate case."""
    distances = np.maximum(distances, 1e-3 * max(distances.max(), np.finfo(np.float64).tiny))
    views = len(distances)

    def ordinary() -> Blend:
        return Blend.ordinary(distances)

    def logits(times: float) -> Blend:
        blend = ordinary()
        # Half of the logits are near the same large number, to test differences of large logits.
        values = blend.logits.reshape(-1)
        values[::2] += np.float32(min(4 * times, float(FLOAT32.max)))
        with np.errstate(over="ignore"):  # infinity
            values[1::2] = values[1::2].astype(np.float64) * times
        return blend

    def far(ratio: float) -> Blend:
        """Far views whose logits compensate for their distance."""
        blend = ordinary()
        blend.distances = distances[0] * ratio ** (np.arange(views) / (views - 1))
        blend.logits += np.log(blend.distances / blend.distances[0]).astype(np.float32)[:, None, None]
        return blend

    def near(distance: float) -> Blend:
        blend = ordinary()
        blend.distances[0] = distance
        return blend.cover(0, lambda pixel: pixel % 3 != 0)

    def thin(coverage: float) -> Blend:
        blend = ordinary()
        for view in range(views):
            blend.cover(view, lambda pixel, view=view: np.where(pixel % (view + 2) == 0, coverage, 0))
        return blend

    def infinite(blend: Blend) -> Blend:
        values = blend.logits.reshape(-1)
        values[1::4] = np.inf
        values[2::4] = values[3::4] = -np.inf
        return blend

    def all_covered(coverage: Callable[[np.ndarray], np.ndarray]) -> Blend:
        blend = ordinary()
        for view in range(views):
            blend.cover(view, coverage)
        return blend

    def of_ratio(ratio: float) -> float:
        """Logarithms of ratios are stored as float32: the larger, the coarser."""
        return BOUND + abs(np.log(ratio)) * FLOAT32.eps / 2

    equal, two_coincide = ordinary(), ordinary()
    equal.logits[:] = 0
    two_coincide.distances[:2] = 0
    special = {
        "all logits equal": equal,
        "infinite logits": infinite(ordinary()),
        "infinite logits, coincident view": infinite(near(0)),
        "target on a view": near(0),
        "two views coincide with the target": two_coincide.cover(0, lambda pixel: pixel % 2 == 0),
        "no view covers any pixel": all_covered(np.zeros_like),
        "one pixel is covered": all_covered(lambda pixel: pixel == 150),
    }
    many = decades(*range(-6, 5), 8, 16, 30, 38)
    ratios, nears, thins = decades(*range(0, 31, 3)), decades(*range(-30, 1, 3)), decades(*range(-40, 1, 4))
    return [
        [Case("logits", f"times {exponent(by)}", logits(by), BOUND) for by in many],
        [Case("ratio of distances", exponent(by), far(by), of_ratio(by)) for by in ratios],
        [Case("nearest view's distance", exponent(by), near(by), of_ratio(by / distances[0])) for by in nears],
        [Case("coverage", exponent(by), thin(by), BOUND + 4 * DENORMAL_STEP / by) for by in thins],
        [Case("special blends", name, blend, BOUND) for name, blend in special.items()],
    ]
