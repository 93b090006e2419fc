"""Score every method on held-out targets: PSNR, SSIM and LPIPS, 16 pixels at each edge left out.

    python -m liveview_ref.paper.score --runs RUNS --scenes FOLDER --textures FOLDER --out ../models/paper/scores

A JSON for each method and number of views, kept after each target: run again, it goes on, and does nothing where
neither the checkpoint's step nor the code that decides the scores has changed. With `--data spaces`, `deepfocus` or
`real` SCENES is that data's folder. Planes that compete have one scale of their logits for each network, fitted on
validation scenes.
"""

import argparse
import sys
from pathlib import Path

import torch

from ..evaluation.lpips import load_lpips
from . import shots
from .captured_samples import kind_of, samples_of
from .registry import ENTRIES, Entry
from .results import write
from .samples import RigSamples
from .scenes import Scenes
from .scoring import Source, load, score, weights_key


def keep_history(folder: Path, entry: Entry, history: list[dict] | None, trained_on: str) -> None:
    """The validation of a method's own training, for the report's curves."""
    if history is not None and weights_key(entry) == entry.key:
        folder.mkdir(exist_ok=True)
        write(folder / f"{trained_on}_{entry.key}.json", history)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=Path, required=True, help="what training wrote: a folder for each method")
    parser.add_argument("--scenes", type=Path, required=True, help="folder of the data's scenes")
    parser.add_argument("--textures", type=Path, required=True, help="folder of photos to paint the rig's scenes with")
    parser.add_argument("--rig-scenes", type=Path, help="folder of the rig's scenes, where SCENES are others'")
    parser.add_argument("--trained-on", type=Path, help="what RUNS were trained on, if not the rig: training's --data")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--data", choices=shots.DATA, default="rig")
    parser.add_argument("--only", nargs="+", metavar="METHOD", help="these alone, such as liveview_v4")
    parser.add_argument("--limit", type=int, default=10**6, help="scenes at most")
    parser.add_argument("--targets", type=int, default=10**6, help="targets of a scene at most")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    chosen = [e for e in ENTRIES if not args.only or e.key in args.only]
    if not chosen:
        parser.error(f"--only {' '.join(args.only)}: none of {', '.join(e.key for e in ENTRIES)}")
    try:
        weights = load_lpips()
    except ModuleNotFoundError as error:
        parser.error(str(error))
    args.out.mkdir(parents=True, exist_ok=True)
    rig_scenes = args.scenes if args.data == "rig" else args.rig_scenes
    if rig_scenes is None and (args.data == "real" or not args.trained_on):
        parser.error(f"--data {args.data}: --rig-scenes is missing; expected the folder of the rig's scenes")
    training = Scenes(rig_scenes, args.textures, "train") if not args.trained_on else None
    samples = samples_of(args.trained_on) if args.trained_on else RigSamples(training)
    trained_on = kind_of(args.trained_on) if args.trained_on else "rig"
    source = Source(args.data, args.scenes, args.textures, args.limit, args.targets, trained_on)
    everything = 10**6
    validation = source if args.data != "real" else Source("rig", rig_scenes, args.textures, everything, everything)
    missing = []
    for entry in chosen:
        try:
            method, about = load(entry, args.runs, samples)
            keep_history(args.out.parent / "history", entry, about.pop("history", None), trained_on)
            score(entry, method, about, source, validation, args.out, weights)
        except FileNotFoundError as error:
            missing.append(f"{entry.key}: {error.filename} is missing: {error.strerror}")
        except ValueError as error:  # of the data's readers
            print(error, file=sys.stderr)
            return 2
    for line in missing:
        print(line, file=sys.stderr)
    return 1 if len(missing) == len(chosen) else 0


if __name__ == "__main__":
    sys.exit(main())
