"""Cases: the inputs of a stage, and its outputs by the package, by others and in float64.

Families of cases vary one quantity over decades, which shows where an implementation fails.

A *doubtful* pixel is one whose value depends on bits that float32 inputs do not have (warp.py).
Outside doubtful pixels the bound of the case holds; of the doubtful ones, a limited share may
exceed it.
"""

from dataclasses import dataclass

import numpy as np

Outputs = dict[str, np.ndarray]  # by name, each [..., pixels]

FLOAT32 = np.finfo(np.float32)


class Inputs:
    """The inputs of a stage. Subclasses have one method for each implementation."""

    stage: str
    must_cover = False  # whether the source must cover some pixel: otherwise the case tests nothing
    relative = False  # whether errors are relative to each output's largest element; else of values in [0, 1]

    def rust(self) -> Outputs:
        """By the package; an exception if it refuses the inputs."""
        raise NotImplementedError

    def others(self) -> dict[str, Outputs]:
        """By "torch", "kornia" and "onnxruntime", or some of them, in float32."""
        raise NotImplementedError

    def truth(self) -> Outputs:
        """In float64, by a simple implementation."""
        raise NotImplementedError

    def doubtful(self) -> np.ndarray | None:
        """Whether each pixel is doubtful; None if none is."""
        return None

    def digits(self, pixel: int) -> list | None:
        """The truth at a pixel in 50 digits; None if there is no such implementation."""
        return None

    def equivalent(self) -> Outputs | None:
        """Outputs that must equal those of the package to the last bit."""
        return None

    def relative_time(self) -> float | None:
        """Run time relative to that on ordinary inputs, for the network."""
        return None


@dataclass
class Case:
    """A line of the table."""

    family: str  # the quantity that varies
    name: str  # its value
    inputs: Inputs
    bound: float  # largest error outside doubtful pixels


def exponent(value: float, digits: int = 0) -> str:
    """1e-6, 2.5e0, inf."""
    mantissa, e, power = f"{value:.{digits}e}".partition("e")
    return f"{mantissa}e{int(power)}" if e else mantissa


def decades(*exponents: int) -> list[float]:
    """Powers of ten."""
    return [float(f"1e{power}") for power in exponents]


def units(seed: int, *shape: int) -> np.ndarray:
    """Pseudo-random float32 numbers in [0, 1), the same each time (splitmix64)."""
    state = np.uint64(seed) + np.uint64(0x9E3779B97F4A7C15) * np.arange(1, np.prod(shape) + 1, dtype=np.uint64)
    for shift, factor in (30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB):
        state = (state ^ (state >> np.uint64(shift))) * np.uint64(factor)
    mixed = (state ^ (state >> np.uint64(31))) >> np.uint64(11)
    return (mixed / 2.0**53).astype(np.float32).reshape(shape)
