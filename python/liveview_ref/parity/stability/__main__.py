"""Stiff and extreme cases of every stage, derived from a scene's rig.

    python -m liveview_ref.parity.stability SCENE --target NAME [--cases FILE]

Prints a table with a line for each family of cases, and writes one with a line for each case. The
exit code is 2 if a case fails; standard error then names it.
"""

import argparse
import sys
from itertools import chain
from pathlib import Path

import torch

from ...paths import MODELS


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--target", required=True, help="the view whose camera is the target, by name")
    parser.add_argument("--short", action="store_true", help="only the ends and the middle of each family")
    parser.add_argument("--cases", type=Path, metavar="FILE", help="where to write every case")
    parser.add_argument("--model", type=Path, default=MODELS / "liveview_v4.onnx")
    try:
        text, failed = compared(**vars(parser.parse_args()))
    except (ImportError, OSError, RuntimeError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(text, end="")
    print("\n".join(failed), end="\n" if failed else "", file=sys.stderr)
    return 2 if failed else 0


def compared(scene: Path, target: str, model: Path, cases: Path | None, short: bool) -> tuple[str, list[str]]:
    """The table of families, and the lines of the cases that fail."""
    # Here, because without the wheel they end in an error.
    from . import blend, composite, composite_competing, network, rigs, sampling, select
    from .outcome import Outcome
    from .table import by_case, by_family, of_case

    torch.set_num_threads(1)
    networks = network.Networks(model)
    rig = rigs.Rig.of(scene, target, networks.rust.views)
    families = [
        *(*rigs.families(rig), *sampling.families(), *blend.families(rig.distances), *composite.families()),
        *(*composite_competing.families(), *select.families(), *network.families(networks)),
    ]
    if short:  # the first, the middle and the last
        families = [[family[i] for i in sorted({0, len(family) // 2, len(family) - 1})] for family in families]
    outcomes = [Outcome.of(case) for case in chain(*families)]
    failed = [of_case(outcome) for outcome in outcomes if any(outcome.failures())]
    about = f"{rig.about}; {model.name}."
    if cases:
        cases.write_text(by_case(about, outcomes))
    return by_family(about, outcomes), failed


if __name__ == "__main__":
    sys.exit(main())
