"""The errors of a case, and whether it passes."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .case import Case, Inputs, Outputs, exponent

CHECKED_PIXELS = 12  # of each case, compared with 50 digits
MAX_DOUBTFUL_OFF = 0.01  # largest share of the doubtful pixels whose error may exceed the bound
# One unit in the last place of 1 in float32, the error of a value rounded twice: allowed even if
# torch happens to be exact.
ALWAYS_ALLOWED = 1.2e-7
MAX_RELATIVE_TIME = 5.0  # of the network on any input; denormal arithmetic takes ten times as long on some CPUs


@dataclass(frozen=True)
class Errors:
    """Of one implementation. `largest` outside doubtful pixels, infinite if any value is not
    finite; `doubtful`: the share of the doubtful pixels whose error exceeds the bound, 0 if it is a
    single one, whose expected value may be wrong."""

    largest: float
    doubtful: float = 0.0


@dataclass
class Truth:
    """The expected outputs in float64, and how errors are measured."""

    outputs: Outputs
    doubtful: np.ndarray
    relative: bool = False

    @classmethod
    def of(cls, inputs: Inputs) -> "Truth":
        outputs, doubtful = inputs.truth(), inputs.doubtful()
        none = np.zeros(next(iter(outputs.values())).shape[-1], bool)
        return cls(outputs, none if doubtful is None else doubtful, inputs.relative)

    def scale(self, name: str) -> float:
        """The divisor of an output's errors. Disparities have a unit: their errors are relative."""
        largest = float(np.abs(self.outputs[name]).max())
        return largest if (self.relative or name == "disparity") and largest > 0 else 1.0

    def errors(self, found: Outputs, bound: float) -> Errors:
        assert found.keys() == self.outputs.keys()
        largest, off = 0.0, np.zeros(len(self.doubtful), bool)
        for name, truth in self.outputs.items():
            assert found[name].size == truth.size, name
            with np.errstate(invalid="ignore"):
                error = np.abs(found[name].astype(np.float64).reshape(-1, len(off)) - truth.reshape(-1, len(off)))
            error = np.where(np.isfinite(error), error / self.scale(name), np.inf)
            largest = max(largest, float(error[~self.doubtful | np.isinf(error)].max(initial=0)))
            off |= (error > bound).any(0) & self.doubtful
        return Errors(largest, float(off.sum() / self.doubtful.sum()) if off.sum() > 1 else 0.0)

    def error(self, inputs: Inputs) -> float | None:
        """Its own largest error against 50 digits over some pixels that are not doubtful: half of
        them random, half random among those with a value other than 0. None without such pixels or
        digits."""
        sure = np.flatnonzero(~self.doubtful)
        parts = {name: values.reshape(-1, len(self.doubtful)) for name, values in self.outputs.items()}
        scale = np.concatenate([np.full(len(values), self.scale(name)) for name, values in parts.items()])
        truth = np.concatenate(list(parts.values()))
        lit = sure[truth[:, sure].any(0)]
        rng = np.random.default_rng(0)
        picked = [rng.choice(some, min(CHECKED_PIXELS // 2, len(some)), replace=False) for some in (sure, lit)]
        errors = []
        for pixel in np.concatenate(picked):
            digits = inputs.digits(int(pixel))
            if digits is None:
                return None
            pairs = zip(digits, truth[:, pixel], scale, strict=True)
            errors += [float(abs(exact - float(found))) / top for exact, found, top in pairs]
        return float(np.max(errors)) if errors else None


@dataclass
class Outcome:
    """The result of a case; `errors` by implementation, "Rust" among them unless it `refused` the
    inputs."""

    case: Case
    errors: dict[str, Errors]
    refused: str | None = None
    equal: bool = True  # whether the outputs that must be equal to the last bit are
    doubtful: float = 0.0  # share of the pixels
    covered: float | None = None  # share of the pixels that the source covers, of a warp
    truth_error: float | None = None  # of the expected outputs against 50 digits
    relative_time: float | None = None

    @classmethod
    def of(cls, case: Case) -> "Outcome":
        inputs, truth = case.inputs, Truth.of(case.inputs)
        found = {}
        outcome = cls(case, {}, doubtful=float(truth.doubtful.mean()))
        try:
            found["Rust"] = inputs.rust()
            other = inputs.equivalent()
            outcome.equal = other is None or all(other[x].tobytes() == y.tobytes() for x, y in found["Rust"].items())
        except (ValueError, TypeError, RuntimeError) as refusal:
            outcome.refused = str(refusal)
            return outcome
        found |= inputs.others()
        outcome.errors = {who: truth.errors(outputs, case.bound) for who, outputs in found.items()}
        if "coverage" in truth.outputs:
            outcome.covered = float((truth.outputs["coverage"] > 0).mean())
        outcome.truth_error, outcome.relative_time = truth.error(inputs), inputs.relative_time()
        return outcome

    def failures(self) -> Iterator[str]:
        """Why the case fails."""
        if self.refused is not None:
            yield f"refused: {self.refused}"
            return
        rust, bound = self.errors["Rust"], self.case.bound
        most = 2 * max(self.errors["torch"].largest, ALWAYS_ALLOWED / 2)
        if not self.equal:
            yield "two results that must be equal to the last bit differ"
        if self.truth_error is not None and not self.truth_error <= bound / 4:
            yield f"the expected outputs are themselves off by {exponent(self.truth_error, 1)}"
        if self.case.inputs.must_cover and self.covered == 0:
            yield "the source covers no pixel: nothing is tested"
        if self.relative_time is not None and self.relative_time > MAX_RELATIVE_TIME:
            yield f"takes {self.relative_time:.1f} times as long as noise"
        if rust.largest > bound:
            yield f"off by {exponent(rust.largest, 1)}, bound {exponent(bound)}"
        if rust.doubtful > MAX_DOUBTFUL_OFF:
            yield f"{rust.doubtful:.0%} of the doubtful pixels are off"
        if rust.largest > most:
            yield f"off by {exponent(rust.largest, 1)}, twice torch's is {exponent(most, 1)}"
