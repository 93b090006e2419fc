"""Score every method on held-out targets: PSNR, SSIM and LPIPS, without a border of 16 pixels.

    python -m liveview_ref.paper.measure.score --runs RUNS --scenes DIR --textures DIR --out OUT

Writes OUT/scores_DATA.json after each target. A second run continues, and skips a method whose
checkpoint's step and whose code have not changed. With `--data real` SCENES is the folder of the
real photos. Competing planes have one scale of their logits for each network, fitted on validation
scenes. The crops of the report's figure go to RUNS/crops.
"""

import argparse
import sys
from pathlib import Path

import torch

from liveview_ref.evaluation.lpips import load_lpips

from ..data import shots
from ..data.samples import RealSamples, RigSamples
from ..data.scenes import Scenes
from ..methods.registry import ENTRIES
from .scoring import Source, load, score


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=Path, required=True, help="the output of training: a folder for each method")
    parser.add_argument("--scenes", type=Path, required=True, help="folder of the data's scenes")
    parser.add_argument("--textures", type=Path, required=True, help="folder of photos to paint the rig's scenes with")
    parser.add_argument("--rig-scenes", type=Path, help="folder of the rig's scenes, with --data real")
    parser.add_argument("--trained-on", type=Path, help="the --data of the training, if not the rig's scenes")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--data", choices=shots.DATA, default="rig")
    parser.add_argument("--only", nargs="+", metavar="METHOD", help="these methods alone, such as liveview_v4")
    parser.add_argument("--limit", type=int, default=10**6, help="most scenes")
    parser.add_argument("--targets", type=int, default=10**6, help="most targets of a scene")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    chosen = [e for e in ENTRIES if not args.only or e.key in args.only]
    if not chosen:
        parser.error(f"--only {' '.join(args.only)}: expected some of {', '.join(e.key for e in ENTRIES)}")
    try:
        weights = load_lpips()
    except ModuleNotFoundError as error:
        parser.error(str(error))
    rig_scenes = args.scenes if args.data == "rig" else args.rig_scenes
    if rig_scenes is None:
        parser.error(f"--data {args.data}: --rig-scenes is missing; expected the folder of the rig's scenes")
    everything = 10**6
    training = Scenes(rig_scenes, args.textures, "train")
    samples = RealSamples(args.trained_on) if args.trained_on else RigSamples(training)
    trained_on = "real" if args.trained_on else "rig"
    crops = args.runs / "crops"
    source = Source(args.data, args.scenes, args.textures, args.limit, args.targets, trained_on, crops)
    validation = source if args.data == "rig" else Source("rig", rig_scenes, args.textures, everything, everything)
    missing = []
    for entry in chosen:
        try:
            method, about = load(entry, args.runs, samples)
            score(entry, method, about, source, validation, args.out, weights)
        except FileNotFoundError as error:
            missing.append(f"{entry.key}: {error.filename} is missing: {error.strerror}")
        except ValueError as error:  # from readers of the data
            print(error, file=sys.stderr)
            return 2
    for line in missing:
        print(line, file=sys.stderr)
    return 1 if len(missing) == len(chosen) else 0


if __name__ == "__main__":
    sys.exit(main())
