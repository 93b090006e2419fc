"""Extreme cases of competing layers: huge logits, ties, thousands of planes, pixels that no layer
or a single one covers."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from ...extension import liveview
from ...reference import competing as reference
from .. import fifty_digits
from .case import FLOAT32, Case, Inputs, Outputs, decades, exponent, units
from .composite import BOUND, PIXELS, by_layer, outputs

ByLayer = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass
class Competing(Inputs):
    """The arguments of the stage: logit, covered and maps [L, 1, P], rgb [L, 3, 1, P], scale."""

    stage = "composite_competing"
    logit: np.ndarray
    covered: np.ndarray
    rgb: np.ndarray
    maps: np.ndarray
    scale: float

    @classmethod
    def of(cls, layers: int, scale: float, logit: ByLayer, covered: ByLayer = lambda *_: 1) -> "Competing":
        """Layers with these logits and coverage, by layer and pixel."""
        rgb, maps = units(13, layers, 3, 1, PIXELS), by_layer(layers, lambda layer, _: 1 / np.float32(1 + layer))
        return cls(by_layer(layers, logit), by_layer(layers, covered) > 0, rgb, maps, scale)

    @classmethod
    def random(cls, layers: int, scale: float, by: float) -> "Competing":
        """Random logits in ±`by`, and a fifth of the layers not covered."""
        logits = by * (2 * units(3, layers, 1, PIXELS).astype(np.float64) - 1)
        covered = units(4, layers, 1, PIXELS) > np.float32(0.2)
        return cls.of(layers, scale, lambda *_: logits, lambda *_: covered)

    def composite(self, by: float) -> Outputs:
        """With logits that many times as large, and the scale smaller by that."""
        logit = np.float32(by) * self.logit
        return outputs(*liveview.composite_competing(logit, self.rgb, self.covered, self.maps, self.scale / by)[:3])

    def rust(self) -> Outputs:
        return self.composite(1)

    def equivalent(self) -> Outputs | None:
        """Unless that overflows."""
        return self.composite(2) if (abs(self.logit) < FLOAT32.max / 2).all() else None

    def others(self) -> dict[str, Outputs]:
        arguments = map(torch.from_numpy, (self.logit, self.rgb, self.covered, self.maps))
        found = reference.composite_competing(*arguments, self.scale)
        return {"torch": outputs(found.rgb, found.disparity, found.transmittance)}

    def truth(self) -> Outputs:
        # An infinite logit counts as the largest finite one of its sign, NaN as the least.
        finite = np.clip(np.nan_to_num(self.logit, nan=FLOAT32.min).astype(np.float64), FLOAT32.min, FLOAT32.max)
        top = np.where(self.covered, finite, -np.inf).max(0)
        weights = np.exp(np.where(self.covered, (finite - top) * self.scale, -np.inf))
        covered = self.covered.any(0)
        weights /= np.where(covered, weights.sum(0), 1)
        return outputs((weights[:, None] * self.rgb).sum(0), (weights * self.maps).sum(0), 1.0 - covered)

    def digits(self, pixel: int) -> list:
        parts = (x[..., 0, pixel] for x in (self.logit, self.rgb, self.covered, self.maps))
        return fifty_digits.composite_competing(*parts, self.scale)


def families() -> list[list[Case]]:
    def case(family: str, extreme: float, inputs: Competing) -> Case:
        return Case(family, f"{extreme:.0f}" if 1 <= extreme < 1e5 else exponent(extreme), inputs, BOUND)

    def line(layers: int, step: float) -> Competing:
        return Competing.of(layers, 1, lambda layer, _: step * layer)

    extremes = np.array([np.inf, -np.inf, 0, -0.0, FLOAT32.max, FLOAT32.min], np.float32)
    special = {
        "no layer covers": Competing.of(9, 1, lambda layer, _: layer, lambda *_: 0),
        "one layer covers": Competing.of(9, 1, lambda *_: -1e38, lambda layer, pixel: layer == pixel % 9),
        "all alike": Competing.of(64, 2, lambda *_: 0.3),
        "ties of two": Competing.of(64, 2, lambda layer, _: layer // 2),
        "nearer to farther ever larger": line(2000, 0.25),
        "ever smaller": line(2000, -0.25),
        "±infinity, ±0, ±largest": Competing.of(36, 1, lambda layer, pixel: extremes[(layer + pixel) % 6]),
        "some not a number": Competing.of(8, 1, lambda layer, pixel: np.where((layer + pixel) % 3, 0.5, np.nan)),
        "none a number": Competing.of(8, 1, lambda *_: np.nan),
    }
    logits, scales, counts = decades(*range(-6, 39, 4)), decades(*range(-4, 5)), [4**power for power in range(7)]
    return [
        [case("competing logits ±", by, Competing.random(32, 2, by)) for by in logits],
        [case("scale of competing", scale, Competing.random(32, scale, 5)) for scale in scales],
        [case("number of competing", n, Competing.random(n, 1, 4)) for n in counts],
        [Case("special competing", name, inputs, BOUND) for name, inputs in special.items()],
    ]
