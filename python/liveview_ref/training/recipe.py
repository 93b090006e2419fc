"""Train the networks of a recipe, one after another; run the same command again to go on.

    python -m liveview_ref.training.recipe configs/recipe.json --data DATA --out RUNS

The recipe names configs of its folder in order, each with the config whose network it starts from
(null: from its seed). The run of a config is RUNS/NAME; shards of examples are in RUNS/shards, the
frames of surface layers, which need `make wheel`, in RUNS/frames_NAME.
SIGTERM ends the training of a network for planes or surface layers with a checkpoint.
"""

import argparse
import json
from pathlib import Path

from ..checkpoint import load_state
from ..config import read_config
from ..data import surface_frames
from ..paths import MODELS
from . import train


def finished(config: Path, run: Path) -> bool:
    checkpoint = run / "checkpoint.pt"
    return checkpoint.exists() and load_state(checkpoint)["step"] >= read_config(config)["steps"]


def start_of(name: str, runs: Path) -> Path:
    """The network of a config: of its run, or the shipped one if it has not been run. What ships
    as v4_planes is that of v4_planes_ordinary."""
    checkpoint = runs / name / "checkpoint.pt"
    return checkpoint if checkpoint.exists() else MODELS / f"liveview_{name.removesuffix('_ordinary')}.onnx"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recipe", type=Path)
    parser.add_argument("--data", type=Path, required=True, help="folder with train/, dev/ and textures/")
    parser.add_argument("--out", type=Path, required=True, help="folder of the runs")
    parser.add_argument("--only", help="one config, from the shipped network if the one it starts from has no run")
    args = parser.parse_args(arguments)
    recipe = json.loads(args.recipe.read_text())
    if args.only and args.only not in recipe:
        parser.error(f"--only: no {args.only} in {args.recipe}; expected {', '.join(recipe)}")
    for name in [args.only] if args.only else recipe:
        config, run, start = args.recipe.parent / f"{name}.json", args.out / name, recipe[name]
        if finished(config, run):
            continue
        print(f"{name}: in {run}", flush=True)
        started = ["--start", str(start_of(start, args.out))] if start else []
        data, shards = ["--data", str(args.data)], args.out / "shards"
        if "frames" in read_config(config):
            shards = args.out / f"frames_{name}"
            surface_frames.main([str(config), *data, "--out", str(shards)])
        folders = [*data, "--out", str(run), "--shards", str(shards)]
        train.main([str(config), *folders, *started])
        if not finished(config, run):
            print(f"{name}: stopped before its last step", flush=True)
            return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
