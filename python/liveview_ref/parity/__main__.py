"""Parity on your own scene.

    python -m liveview_ref.parity SCENE --target NAME

Renders a view by the Python package (`make wheel`), computes each stage again from the same inputs,
in float64 (the oracle) and float32 torch, and prints a table: elements, largest and mean error of
Rust and of torch. The last line names the first stage at which Rust exceeds the bounds of
parity/tolerances.json, and the exit code is then 1.

The search of the photos' depth, for surface layers, is compared on a second render with smaller
photos (--search-width; 0: not at all), because the oracle is slow. With --network none the logits
are those of the views' agreement.
"""

import argparse
import sys
from pathlib import Path

DEPARTS = """\
A stage departs where Rust's error exceeds its bound (parity/tolerances.json gives the reason for each): the stages
before it are right, and the row says where it is worst. "torch itself departs": float32 torch is beyond the bound as
well, so that the case is stiff, not Rust wrong. Please report the table with the scene."""
SEARCH_WIDTH = 96  # pixels; six photos take about half a minute, and eight times that at twice the width


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--target", required=True, help="the view to render, by name; it is held out")
    parser.add_argument("--layers", help="as those of the program")
    parser.add_argument("--views", type=int)
    parser.add_argument("--network", choices=("none", "model"))
    parser.add_argument("--model", type=Path)
    parser.add_argument("--alpha", choices=("independent", "competing"))
    parser.add_argument("--engine")
    parser.add_argument("--precision", choices=("f32", "bf16", "int8"))
    parser.add_argument("--near", type=float)
    parser.add_argument("--far", type=float)
    parser.add_argument("--images", help="the photos' folder")
    parser.add_argument("--width", type=int)
    parser.add_argument("--search-width", type=int, default=SEARCH_WIDTH)
    parser.add_argument("--both-ways", action="store_true", help="a stage whose decisions are all the same departs")
    options = vars(parser.parse_args())
    try:
        first = first_that_departs(**options)
    except (ImportError, OSError, RuntimeError, TypeError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except SystemExit as end:  # a stage that ends the program must not look like success
        print(f"the reference ended the program: {end!r}", file=sys.stderr)
        return 1
    print(f"first stage that departs: {first or 'none'}")
    if first:
        print(DEPARTS, file=sys.stderr)
    return int(first is not None)


def first_that_departs(
    scene: Path,
    target: str,
    images: str | None,
    width: int | None,
    search_width: int,
    network: str | None,
    both_ways: bool,
    **options,
) -> str | None:
    # Here, because it needs the wheel, and so that an exit on import is an error as well.
    from ..extension import liveview
    from .render import Rendered, report

    if network or any(options[name] for name in ("model", "alpha", "engine", "precision")):
        options["network"] = network != "none"
    rendered = Rendered.of(liveview.Scene(scene, width=width, images=images), target, **options)
    reduced = None
    if rendered.about["layers"].startswith("surface") and search_width:
        small = liveview.Scene(scene, width=min(search_width, width or search_width), images=images)
        reduced = Rendered.of(small, target, **options)
    return report(scene, rendered, reduced, both_ways)


if __name__ == "__main__":
    sys.exit(main())
