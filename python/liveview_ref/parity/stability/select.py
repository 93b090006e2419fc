"""Extreme cases of the plane selection, with nothing or too much to choose from; expected outputs
by counting."""

from dataclasses import dataclass

import numpy as np
import torch

from ...extension import liveview
from ...reference import liveview as reference
from .case import FLOAT32, Case, Inputs, Outputs, units

PIXELS = 67


@dataclass
class Select(Inputs):
    """Alpha of D planes [D, 1, P], of which `count` are to be selected."""

    stage = "select"
    alpha: np.ndarray
    count: int

    def outputs(self, histogram, selected: list[int]) -> Outputs:
        """The histogram, and whether each plane was selected (1) or not (0); one "pixel" for each
        plane."""
        return {"histogram": np.asarray(histogram), "selected": np.isin(np.arange(len(self.alpha)), selected) * 1.0}

    def rust(self) -> Outputs:
        histogram = liveview.plane_histogram(self.alpha)
        return self.outputs(histogram, liveview.select_planes(histogram, self.count))

    def others(self) -> dict[str, Outputs]:
        histogram = reference.plane_histogram(torch.from_numpy(self.alpha))
        return {"torch": self.outputs(histogram, reference.select_planes(histogram, self.count))}

    def truth(self) -> Outputs:
        best = self.alpha.argmax(0)[self.alpha.max(0) > 0]
        votes = np.bincount(best, minlength=len(self.alpha))
        # The fullest bins, of equally full ones the nearer.
        fullest = sorted(range(len(votes)), key=lambda plane: (-votes[plane], plane))
        return self.outputs(votes, fullest[: self.count])


def families() -> list[list[Case]]:
    def random(planes: int) -> np.ndarray:
        return units(planes, planes, 1, PIXELS)

    def all_planes(value: float) -> np.ndarray:
        return np.full((8, 1, PIXELS), value, np.float32)

    one_bin = all_planes(0)
    one_bin[5] = 1
    special = {
        "ties between bins and between α": (np.floor(random(8) * 3) / 3, 3),
        "all α equal": (all_planes(0.5), 3),
        "all α 0": (all_planes(0), 3),
        "denormal α": (all_planes(FLOAT32.smallest_subnormal), 3),
        "one plane": (random(1), 1),
        "more requested than there are": (random(8), 20),
        "all but one bin empty": (one_bin, 3),
        "4,096 planes": (random(4096), 16),
    }
    return [[Case("selection", name, Select(*arguments), 0) for name, arguments in special.items()]]
