"""Extreme cases of the composite: stiff opacities and thousands of planes."""

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import nn

from ...extension import liveview
from ...reference import liveview as reference
from ...reference.layers import accumulate, empty
from .. import fifty_digits
from .case import FLOAT32, Case, Inputs, Outputs, decades, exponent, units
from .onnx_graph import Graph

PIXELS = 67
BOUND = 1.2e-7  # sums in float64, rounded to float32 once


class Module(nn.Module):
    """One more plane behind the previous ones."""

    def forward(self, rgb, disparity, transmittance, *plane):
        return accumulate((rgb, disparity, transmittance), *plane)


@functools.cache
def graph() -> Graph:
    size = 1, PIXELS
    plane = (*(np.ones((1, *n, *size), np.float32) for n in ((), (3,), (1,))), np.ones(1, np.float32), np.array([True]))
    return Graph(Module(), (*(x.numpy() for x in empty(size)), *plane), {})


def outputs(rgb, disparity, transmittance) -> Outputs:
    found = {"frame": rgb, "disparity": disparity, "transmittance": transmittance}
    return {name: np.asarray(x)[..., 0, :] for name, x in found.items()}


def by_layer(layers: int, values: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """Values of the layers and pixels [L, 1, P], float32."""
    found = values(np.arange(layers)[:, None, None], np.arange(PIXELS))
    return np.broadcast_to(found, (layers, 1, PIXELS)).astype(np.float32)


@dataclass
class Composite(Inputs):
    """The arguments of the stage: alpha and maps [L, 1, P], rgb [L, 3, 1, P]; `background`: whether
    the farthest layer is covered, so that its alpha counts as 1. `split`: composite this many
    layers and the rest separately, then combine the two."""

    stage = "composite"
    alpha: np.ndarray
    rgb: np.ndarray
    maps: np.ndarray
    background: bool = True
    split: int = 0
    relative: bool = False

    @classmethod
    def of(cls, layers: int, ratio: float, alpha: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> "Composite":
        """Layers with these opacities (by layer and pixel), whose depths span a factor of `ratio`,
        at disparities evenly from 1 to 1 / ratio."""
        maps = by_layer(layers, lambda layer, _: 1 + layer / (max(layers, 2) - 1) * (1 / ratio - 1))
        return cls(by_layer(layers, alpha), units(11, layers, 3, 1, PIXELS), maps)

    def arguments(self, part: slice) -> tuple[np.ndarray, ...]:
        covered = np.full((1, PIXELS), self.background and part.stop is None)
        return self.alpha[part], self.rgb[part], covered, self.maps[part]

    def rust(self) -> Outputs:
        behind = liveview.composite(*self.arguments(slice(self.split, None)))
        if not self.split:
            return outputs(*behind[:3])
        front = liveview.composite(*self.arguments(slice(self.split)))
        through = front.transmittance.astype(np.float64)
        sums = [a + through * b for a, b in zip(front[:2], behind[:2], strict=True)]
        return outputs(*(x.astype(np.float32) for x in (*sums, through * behind.transmittance)))

    def others(self) -> dict[str, Outputs]:
        alpha, rgb, covered, maps = arguments = self.arguments(slice(None))
        found = reference.composite(*map(torch.from_numpy, arguments))
        state, covered = [x.numpy() for x in empty(covered.shape)], covered[None, None].astype(np.float32)
        for k in range(len(alpha)):
            plane, last = slice(k, k + 1), np.array([k == len(alpha) - 1])
            # Every plane has a constant disparity.
            state = graph()(*state, alpha[plane], rgb[plane], covered, maps[k, 0, :1], last)
        in_torch = outputs(found.rgb, found.disparity, found.transmittance)
        return {"torch": in_torch, "onnxruntime": outputs(*state)}

    def truth(self) -> Outputs:
        alpha = self.alpha.astype(np.float64)
        if self.background:
            alpha[-1] = 1
        left = np.cumprod(np.concatenate([np.ones((1, 1, PIXELS)), 1 - alpha]), 0)
        weights = left[:-1] * alpha
        return outputs((weights[:, None] * self.rgb).sum(0), (weights * self.maps).sum(0), left[-1])

    def digits(self, pixel: int) -> list:
        parts = (x[..., 0, pixel] for x in (self.alpha, self.rgb, self.maps))
        return fifty_digits.composite(*parts, self.background)


def families() -> list[list[Case]]:
    almost = 1 - FLOAT32.eps / 2

    def stiff(layers: int, alpha: Callable[[np.ndarray], np.ndarray]) -> Composite:
        """The first layer is black, there is no background, and errors are relative: the picture is
        what shows through the first layer."""
        found = replace(Composite.of(layers, 4, lambda layer, _: alpha(layer)), background=False, relative=True)
        found.rgb[0], found.maps[0] = 0, 0
        return found

    def opaque_then_faint(first: np.float32) -> Composite:
        return stiff(1001, lambda layer: np.where(layer == 0, first, np.float32(1e-3)))

    def alternating(faint: float) -> Composite:
        """Few enough layers that the remaining transmittance is a float32 number."""
        return stiff(8, lambda layer: np.where(layer % 2 == 0, faint, 1 - faint))

    def many(layers: int) -> Composite:
        unit = units(5, PIXELS)
        share = 4 / np.float32(layers)
        return Composite.of(layers, 4, lambda layer, pixel: np.minimum(unit[(pixel + layer) % PIXELS] * share, 1))

    def ratio(ratio: float) -> Composite:
        return Composite.of(64, ratio, lambda layer, pixel: np.where((layer + pixel) % 3 == 0, 0.1, 0.01))

    extremes = np.array([0, -0.0, FLOAT32.smallest_subnormal, FLOAT32.tiny, almost, 1], np.float32)
    # All white: the frame is the sum of the weights, which is 1 minus the remaining transmittance.
    white = replace(many(1024), background=False)
    white.rgb[:] = 1
    special = {
        "0, -0, denormal, 1 - 2⁻²⁴, 1": Composite.of(
            36, 4, lambda layer, pixel: extremes[(pixel // 6 ** (layer % 2) + layer) % 6]
        ),
        "all transparent": replace(Composite.of(64, 4, lambda *_: 0), background=False),
        "all opaque": Composite.of(64, 4, lambda *_: 1),
        "one plane": Composite.of(1, 1, lambda *_: 0.25),
        "composited in two parts": replace(ratio(4), split=20),
        "all at one disparity": Composite.of(64, 1, lambda layer, _: np.float32(1) / (2 + layer)),
        "white, without background": white,
    }
    firsts = [min(np.float32(1 - left), np.float32(almost)) for left in decades(*range(-8, 1))]
    faint, ratios, counts = decades(*range(-10, 0)), decades(*range(13)), [4**power for power in range(7)]
    opaque = [(exponent(1 - float(first)), opaque_then_faint(first)) for first in firsts]
    return [
        [Case("1,000 faint behind opaque", f"T {left}", case, BOUND) for left, case in opaque],
        [Case("alternating α, 1 - α", f"α {exponent(by)}", alternating(by), BOUND) for by in faint],
        [Case("number of planes", str(n), many(n), BOUND) for n in counts],
        [Case("far / near", exponent(by), ratio(by), BOUND) for by in ratios],
        [Case("special composites", name, case, BOUND) for name, case in special.items()],
    ]
