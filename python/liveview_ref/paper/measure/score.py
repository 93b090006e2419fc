"""Score every method on held-out targets: PSNR, SSIM and LPIPS, without a border of 16 pixels.

    python -m liveview_ref.paper.measure.score --runs RUNS --scenes DIR --textures DIR --out OUT

Writes OUT/scores_DATA.json after each target. A second run continues, and begins again with a
method whose training has gone on; delete the file after a change of the code. With `--data real`
SCENES is the folder of the real photos. Competing planes have one scale of their logits for each
network, fitted on validation scenes."""

import argparse
import sys
from dataclasses import dataclass, replace
from errno import ENOENT
from pathlib import Path
from statistics import fmean, stdev

import torch
from torch import Tensor, nn

from liveview_ref.checkpoint import load_state
from liveview_ref.data.held_out import BORDER, INNER
from liveview_ref.evaluation import lpips as perceptual
from liveview_ref.reference import metrics

from .. import train
from ..data import shots
from ..data.samples import RealSamples, RigSamples
from ..data.scenes import Scenes
from ..data.shots import window
from ..files import read, write
from ..methods.method import Method
from ..methods.registry import ENTRIES, Entry
from . import variants

SCALES = 0.5, 1.0, 2.0, 4.0, 8.0, 16.0


@dataclass
class Source:
    """Where targets come from."""

    data: str
    folder: Path
    textures: Path
    scenes: int
    targets: int
    trained_on: str = "rig"

    def shots(self, split: str, views: int):
        return shots.shots(self.data, self.folder, self.textures, split, views, self.scenes, self.targets)


def scores_of(image: Tensor, truth: Tensor, weights) -> dict[str, float]:
    """psnr (dB), ssim and lpips (if `weights` are given) inside the border."""
    a, b = image.clamp(0, 1)[INNER], truth[INNER]
    found = {"psnr": metrics.psnr(a, b), "ssim": metrics.ssim(a, b)}
    if weights is not None:
        found["lpips"] = perceptual.lpips(weights, a, b)
    return {metric: round(value, 5) for metric, value in found.items()}


def load(entry: Entry, runs: Path, samples: train.Samples) -> tuple[Method, dict]:
    """The method with its averaged weights, and the figures of its training. BatchNorm's statistics
    are estimated again, since training does so only when it validates. FileNotFoundError if it is
    not trained yet."""
    method = entry.build(entry.views)
    if not any(True for _ in method.parameters()):
        return method.eval(), {"step": None}
    path = runs / entry.weights_key / "checkpoint.pt"
    if not path.exists():
        raise FileNotFoundError(ENOENT, "not trained yet", str(path))
    state = load_state(path)
    method.load_state_dict(state["average"])
    about = {"step": state["step"], "samples": state["step"] * train.BATCH, "core_seconds": round(state["seconds"])}
    about["planes"] = entry.planes_of(state)
    if any(isinstance(m, nn.modules.batchnorm._BatchNorm) for m in method.modules()):
        last = state["step"] * train.BATCH
        numbers = [(last - 1 - n) % last for n in range(train.STATISTICS * train.BATCH)]
        drawn = [samples(entry.views, n) for n in numbers]
        batches = [drawn[i : i + train.BATCH] for i in range(0, len(drawn), train.BATCH)]
        train.estimate_statistics(method, batches, about["planes"])
    return method.eval(), about


def fitted_scale(method: Method, entry: Entry, source: Source) -> dict[float, float]:
    """Mean PSNR of each scale over the first targets of the validation scenes, on the most planes;
    of the middle half of each target's width and height, which is enough to choose a scale."""
    found = {scale: [] for scale in SCALES}
    count = max(entry.planes)
    for shot in replace(source, scenes=10**6, targets=1).shots("validation", entry.views):
        width, height = shot.camera.width // 2, shot.camera.height // 2
        shot = window(shot, width // 2, height // 2, width, height)
        with torch.inference_mode():
            planes = variants.plane_by_plane(method, shot, shot.planes(count))
            for scale, rows in found.items():
                image, _ = variants.competing(planes, scale)
                rows.append(metrics.psnr(image[INNER], shot.truth[INNER]))
    return {scale: round(fmean(rows), 4) for scale, rows in found.items() if rows}


def score(entry: Entry, method: Method, about: dict, source: Source, validation: Source, out: Path, weights) -> dict:
    """Score an entry, continuing an earlier run; the scale of competing planes is
    fitted on `validation`."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"scores_{source.data}.json"
    reports = read(path) if path.exists() else {}
    key = {"step": about["step"], "trained_on": source.trained_on}
    report = reports.get(entry.key, {})
    if report.get("key") != key:
        report = {"entry": entry.key, "name": entry.name, "views": entry.views, "data": source.data, "key": key}
        report |= {"about": about, "border": BORDER, "targets": []}
        if variants.is_liveview(method):
            scales = fitted_scale(method, entry, validation)
            report["scales"] = {str(scale): psnr for scale, psnr in scales.items()}
            report["scale"] = max(scales, key=scales.__getitem__)
    done = {(target["scene"], target["target"]) for target in report["targets"]}
    for shot in source.shots("test", entry.views):
        if (shot.scene, shot.target) in done:
            continue
        found = {}
        for layers, image in variants.renderings(method, shot, entry.planes, report.get("scale", 1.0)):
            found[layers] = scores_of(image, shot.truth, weights)
        report["targets"].append({"scene": shot.scene, "target": shot.target, "scores": found})
        report["mean"] = mean(report["targets"])
        write(path, reports | {entry.key: report})
        best = max(found, key=lambda layers: found[layers]["psnr"])
        print(f"{entry.key} {shot.scene}/{shot.target}: {best} {found[best]['psnr']:.2f} dB", flush=True)
    return report


def mean(targets: list[dict]) -> dict[str, dict[str, float]]:
    """Per kind of layers: the mean over scenes of the means over their targets, and its standard
    error (`_se`, over scenes, absent for a single one)."""
    out = {}
    for layers in targets[0]["scores"]:
        by_scene: dict[str, list[dict]] = {}
        for target in targets:
            by_scene.setdefault(target["scene"], []).append(target["scores"][layers])
        row = {}
        for metric in targets[0]["scores"][layers]:
            means = [fmean(scores[metric] for scores in rows) for rows in by_scene.values()]
            row[metric] = round(fmean(means), 5)
            if len(means) > 1:
                row[f"{metric}_se"] = round(stdev(means) / len(means) ** 0.5, 5)
        out[layers] = row
    return out


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
        weights = perceptual.load_lpips()
    except ModuleNotFoundError as error:
        parser.error(str(error))
    rig_scenes = args.scenes if args.data == "rig" else args.rig_scenes
    if rig_scenes is None:
        parser.error(f"--data {args.data}: --rig-scenes is missing; expected the folder of the rig's scenes")
    everything = 10**6
    training = Scenes(rig_scenes, args.textures, "train")
    samples = RealSamples(args.trained_on) if args.trained_on else RigSamples(training)
    trained_on = "real" if args.trained_on else "rig"
    source = Source(args.data, args.scenes, args.textures, args.limit, args.targets, trained_on)
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
