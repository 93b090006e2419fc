"""Parity on your own scene.

    python -m liveview_ref.parity SCENE --target NAME [options of liveview dump]

Lets the Rust binary dump every stage of one render, computes each stage again from the same inputs,
in float64 (the oracle) and float32 torch, and prints a table: elements, largest and mean error of
Rust and of torch. The last line names the first stage at which Rust exceeds the bounds of
parity/tolerances.json, and the exit code is then 1.

The search of the photos' depth, for surface layers, is compared on a second dump with smaller
photos (--search-width; 0: not at all), because the oracle is slow. With --network none the logits
are those of the views' agreement.
"""

import argparse
import sys
from pathlib import Path

from ..paths import BINARY

SEARCH_WIDTH = 96  # pixels; six photos take about half a minute, and eight times that at twice the width


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--binary", type=Path, default=BINARY)
    parser.add_argument("--width", type=int)
    parser.add_argument("--search-width", type=int, default=SEARCH_WIDTH)
    args, rest = parser.parse_known_args()
    try:
        first = first_that_departs(args, rest)
    except ValueError as error:
        print(error, end="", file=sys.stderr)
        return 2
    except SystemExit as end:  # a stage that ends the program must not look like success
        print(f"the reference ended the program: {end!r}", file=sys.stderr)
        return 1
    print(f"first stage that departs: {first or 'none'}")
    return int(first is not None)


def first_that_departs(args: argparse.Namespace, rest: list[str]) -> str | None:
    from .live.run import Dump, report  # here, so that an exit on import is an error as well

    dump = Dump.of(args.binary, args.scene, [*rest, *(["--width", str(args.width)] if args.width else [])])
    reduced = None
    if dump.about["layers"].startswith("surface") and args.search_width:
        width = min(args.search_width, args.width or args.search_width)
        reduced = Dump.of(args.binary, args.scene, [*rest, "--search", "--width", str(width)])
    return report(args.scene, dump, reduced)


if __name__ == "__main__":
    sys.exit(main())
