"""The outcomes as Markdown, with a line for each family and each case."""

from itertools import groupby

import numpy as np

from .case import exponent
from .outcome import Outcome

WHO = "Rust", "torch", "kornia", "onnxruntime"

HOW_TO_READ = """\
Errors are the largest of a case against float64, of values in [0, 1], or relative to the largest (disparity, logits,
stiff composites); "covered" is the share of the pixels that the source covers. **Bold** is beyond the bound, *NaN* is
not finite. Doubtful pixels, whose value depends on bits that float32 inputs do not have, are counted separately: of
those at most 1 % may be beyond the bound. Torch, kornia (unmodified: it does not mask points behind the camera) and
onnxruntime compute in float32. Rust's error must be within the bound and at most twice torch's, or 1.2e-7."""


def markdown(about: str, outcomes: list[Outcome]) -> str:
    """`about` is the rig and the model, one line."""
    failed = sum(any(outcome.failures()) for outcome in outcomes)
    lines = [
        f"# Stiff and extreme cases\n\n{about}\n\n{HOW_TO_READ}\n",
        f"{len(outcomes) - failed} of {len(outcomes)} cases pass.\n",
        *header("stage", "varied", "from", "to", "cases", *WHO, ""),
        *(of_family(list(family)) for _, family in groupby(outcomes, lambda outcome: outcome.case.family)),
        "",
        *header("case", "", *WHO, "bound", "covered", "doubtful", ""),
        *(of_case(outcome) for outcome in outcomes),
    ]
    return "\n".join(lines) + "\n"


def header(*cells: str) -> list[str]:
    return [row(*cells), "|" + "---|" * len(cells)]


def row(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"


def of_family(family: list[Outcome]) -> str:
    first, last = family[0].case, family[-1].case
    worst = [max(family, key=lambda o, who=who: o.errors[who].largest if who in o.errors else -1) for who in WHO]
    figures = [figure(outcome, who) for outcome, who in zip(worst, WHO, strict=True)]
    failed = sum(any(outcome.failures()) for outcome in family)
    verdict = f"**{failed} failed**" if failed else "ok"
    return row(first.inputs.stage, first.family, first.name, last.name, str(len(family)), *figures, verdict)


def of_case(outcome: Outcome) -> str:
    case, why = outcome.case, next(outcome.failures(), None)
    slower = f", {outcome.relative_time:.2f} times as long as noise" if outcome.relative_time else ""
    return row(
        *(case.family, case.name, *(figure(outcome, who) for who in WHO), exponent(case.bound)),
        *("" if outcome.covered is None else percent(outcome.covered), doubtful(outcome)),
        (f"**failed**: {why}" if why else "ok") + slower,
    )


def figure(outcome: Outcome, who: str) -> str:
    if who not in outcome.errors:
        return ""
    largest = outcome.errors[who].largest
    if np.isinf(largest):
        return "*NaN*"
    text = exponent(largest, 1) if largest else "0"
    return f"**{text}**" if largest > outcome.case.bound else text


def doubtful(outcome: Outcome) -> str:
    """The share of doubtful pixels, and of these the share whose error exceeds the bound."""
    off = outcome.errors["Rust"].doubtful if outcome.errors else 0
    share = percent(outcome.doubtful) if outcome.doubtful else ""
    return f"{share}, {percent(off)} of them off" if off else share


def percent(share: float) -> str:
    return f"{100 * share:.3f} %" if 0 < share < 1e-3 else f"{100 * share:.1f} %"
