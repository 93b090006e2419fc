"""The outcomes as Markdown: a table of the families, and one of every case."""

from itertools import groupby

import numpy as np

from .case import exponent
from .outcome import Outcome

WHO = "Rust", "torch", "kornia", "onnxruntime"

HOW_TO_READ = """\
"covered" is the share of the pixels that the source covers. *NaN* is not finite. Doubtful pixels, whose value depends
on bits that float32 inputs do not have, are counted separately: of those at most 1 % may be beyond the bound. Rust's
error must be within the bound and at most twice torch's, or 1.2e-7. Kornia is unmodified: it does not mask points
behind the camera."""


def by_family(about: str, outcomes: list[Outcome]) -> str:
    """The largest errors of each family of cases; `about` is the rig and the model, one line."""
    lines = [
        f"# Stiff and extreme cases\n\n{about}\n\nLargest errors against float64, of values in [0, 1], or relative;"
        " **bold**: beyond the bound of its case.\n`make stability` writes every case to target/stability_cases.md.\n",
        f"{passing(outcomes)}\n",
        *header("what varies", "from, to", "Rust", "torch", ""),
        *(of_family(list(family)) for _, family in groupby(outcomes, lambda outcome: outcome.case.family)),
    ]
    return "\n".join(lines) + "\n"


def by_case(about: str, outcomes: list[Outcome]) -> str:
    """Every case, by every implementation."""
    lines = [
        f"# Stiff and extreme cases\n\n{about}\n\n{HOW_TO_READ}\n\n{passing(outcomes)}\n",
        *header("case", "", *WHO, "bound", "covered", "doubtful", ""),
        *(of_case(outcome) for outcome in outcomes),
    ]
    return "\n".join(lines) + "\n"


def passing(outcomes: list[Outcome]) -> str:
    failed = sum(any(outcome.failures()) for outcome in outcomes)
    return f"{len(outcomes) - failed} of {len(outcomes)} cases pass."


def header(*cells: str) -> list[str]:
    return [row(*cells), "|" + "---|" * len(cells)]


def row(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"


def of_family(family: list[Outcome]) -> str:
    first, last = family[0].case, family[-1].case
    figures = []
    for who in ("Rust", "torch"):
        worst = max(family, key=lambda o, who=who: o.errors[who].largest if who in o.errors else -1)
        figures.append(figure(worst, who))
    failed = sum(any(outcome.failures()) for outcome in family)
    return row(first.family, f"{first.name}, {last.name}", *figures, f"**{failed} failed**" if failed else "ok")


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
