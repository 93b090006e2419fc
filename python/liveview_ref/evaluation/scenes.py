"""Score the program's pictures on many scenes, as it delivers them.

    python -m liveview_ref.evaluation.scenes SPEC.json --data DATA --out DIR

The spec, configs/scenes.json, lists scenes in the data folder or in this repository, with their
held-out photos. Writes scores.json and scores.md, and a contact sheet SCENE.jpg of each scene
(truth, picture, four times their difference), which shows the scene's photos: DIR is not for the
repository unless their licence allows it.
"""

import argparse
import json
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import fmean

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from ..data.held_out import BORDER, INNER
from ..paths import BINARY, ROOT
from ..reference.metrics import psnr, ssim
from .lpips import load_lpips, lpips

DEFAULT = "--layers surface:3 --network none"
SEPARATOR = 4  # pixels between the pictures of a comparison
EDGE = 20 / 255  # a larger difference of neighbouring pixels' grey values is an edge of the truth
NEAR_EDGE = 3  # pixels from an edge that are left out of tearing
TORN = 40 / 255  # a larger error in some channel is visible
SHEET_WIDTH = 1440
METRICS = {"psnr": ("PSNR dB", 2), "ssim": ("SSIM", 4), "lpips": ("LPIPS", 3), "torn": ("torn %", 2)}
COLUMNS = METRICS | {"uncovered": ("uncovered %", 2), "guessed": ("guessed %", 1)}  # name, digits

Scores = dict[str, float]


def tearing(picture: Tensor, truth: Tensor) -> float:
    """Share (percent) of the pixels away from the truth's own edges at which the error is visible.

    At an edge a fraction of a pixel is a large error that nobody sees; elsewhere a large error is a
    patch of something else: torn surfaces, ghosts, wrong colours.
    """
    grey = truth.mean(0)
    steps = torch.zeros_like(grey)
    across, down = (grey[:, 1:] - grey[:, :-1]).abs(), (grey[1:] - grey[:-1]).abs()
    steps[:, 1:] = across
    steps[1:] = torch.maximum(steps[1:], down)
    size = 2 * NEAR_EDGE + 1
    near_edge = torch.nn.functional.max_pool2d(steps[None], size, 1, NEAR_EDGE)[0] > EDGE
    torn = (picture - truth).abs().amax(0) > TORN
    away = ~near_edge
    return 100 * float((torn & away).sum() / away.sum().clamp(min=1))


def options_of(spec: dict) -> list[str]:
    """Options of `render` that hold out and render the scene's targets."""
    if "heldout" in spec:
        return ["--heldout", str(spec["heldout"])]
    range_ = [text for end in ("near", "far") if end in spec for text in (f"--{end}", str(spec[end]))]
    return ["--target", ",".join(spec["targets"] + spec.get("held_out", [])), *range_]


def panels(path: Path) -> tuple[Image.Image, Tensor, Tensor]:
    """A comparison, and its truth and picture [3, H, W]."""
    image = Image.open(path).convert("RGB")
    width = (image.width - 2 * SEPARATOR) // 3
    pixels = torch.from_numpy(np.asarray(image, np.float32) / 255).permute(2, 0, 1)
    return image, pixels[..., :width], pixels[..., width + SEPARATOR :][..., :width]


def score_scene(binary: Path, root: Path, spec: dict, options: list[str], weights) -> tuple[dict, list[Image.Image]]:
    """Scores of each target, and the comparisons."""
    with tempfile.TemporaryDirectory() as folder:
        out = ["-o", f"{folder}/pictures/", "--compare", f"{folder}/compared/", "--json"]
        command = [str(binary), "render", str(root), *options_of(spec), *options, *out]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{' '.join(command)}: {done.stderr.strip()}")
        scores, images = {}, []
        for target in json.loads(done.stdout)["targets"]:
            name = target["name"]
            if name in spec.get("held_out", []):
                continue
            image, truth, picture = panels(Path(folder) / "compared" / f"{Path(name).stem}.png")
            pair = picture[INNER], truth[INNER]
            found = {"psnr": psnr(*pair), "ssim": ssim(*pair), "lpips": lpips(weights, *pair), "torn": tearing(*pair)}
            found["uncovered"] = 100 * target["uncovered_share"]
            found["guessed"] = 100 * (target["guessed_share"] or 0)
            scores[name] = {key: round(value, 5) for key, value in found.items()}
            images.append(image)
    return scores, images


def mean(rows: list[Scores]) -> Scores:
    return {key: round(fmean(row[key] for row in rows), 5) for key in COLUMNS}


def sheet(images: list[Image.Image]) -> Image.Image:
    """The comparisons of a scene below each other."""
    small = [image.resize((SHEET_WIDTH, round(image.height * SHEET_WIDTH / image.width))) for image in images]
    found = Image.new("RGB", (SHEET_WIDTH, sum(image.height for image in small)))
    top = 0
    for image in small:
        found.paste(image, (0, top))
        top += image.height
    return found


def markdown(report: dict) -> str:
    def row(name: str, scores: Scores) -> str:
        return f"| {name} | " + " | ".join(f"{scores[key]:.{digits}f}" for key, (_, digits) in COLUMNS.items()) + " |"

    lines = [
        "# Scores by scene",
        "",
        f"`liveview render {' '.join(report['options'])}`: the pictures as written (8 bits, uncovered pixels",
        f"inpainted), without a border of {BORDER} pixels. Torn: share of the pixels away from the truth's edges whose",
        "error exceeds 40/255 in some channel.",
        "",
        "| scene | " + " | ".join(title for title, _ in COLUMNS.values()) + " |",
        "|---" * (1 + len(COLUMNS)) + "|",
        *(row(name, scene["mean"]) for name, scene in report["scenes"].items()),
        *(row(f"**mean of {name}**", scores) for name, scores in report["means"].items()),
    ]
    return "\n".join(lines + [f"\nSkipped: {name}, {why}." for name, why in report["skipped"].items()]) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("spec", type=Path, help="JSON list of scenes, like configs/scenes.json")
    parser.add_argument("--data", type=Path, required=True, help="folder with dev/")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--scenes", help="comma-separated names; default: all")
    parser.add_argument("--binary", type=Path, default=BINARY)
    parser.add_argument("--options", default=DEFAULT, help="of render, in one argument; default: %(default)s")
    args = parser.parse_args()
    specs = {spec["name"]: spec for spec in json.loads(args.spec.read_text())}
    wanted = args.scenes.split(",") if args.scenes else list(specs)
    if unknown := set(wanted) - set(specs):
        parser.error(f"--scenes: no {', '.join(sorted(unknown))}; expected {', '.join(specs)}")
    try:
        weights = load_lpips()
    except ModuleNotFoundError as error:
        parser.error(str(error))
    options = shlex.split(args.options)
    report = {"options": options, "scenes": {}, "means": {}, "skipped": {}}
    args.out.mkdir(parents=True, exist_ok=True)
    for name in wanted:
        spec = specs[name]
        root = next((folder / spec["path"] for folder in (args.data, ROOT) if (folder / spec["path"]).is_dir()), None)
        if root is None:
            report["skipped"][name] = "the folder is missing"
            continue
        scores, images = score_scene(args.binary.absolute(), root, spec, options, weights)
        sheet(images).save(args.out / f"{name.replace(' ', '_')}.jpg", quality=90)
        report["scenes"][name] = {"mean": mean(list(scores.values())), "targets": scores}
        report["means"] = {
            kind: mean(
                [scene["mean"] for scene_name, scene in report["scenes"].items() if specs[scene_name]["set"] == kind]
            )
            for kind in dict.fromkeys(specs[scene]["set"] for scene in report["scenes"])
        }
        found = report["scenes"][name]["mean"]
        print(
            f"{name}: " + ", ".join(f"{found[key]:.{n}f} {title}" for key, (title, n) in COLUMNS.items()),
            file=sys.stderr,
        )
    (args.out / "scores.json").write_text(json.dumps(report, indent=1) + "\n")
    (args.out / "scores.md").write_text(markdown(report))
    for name, why in report["skipped"].items():
        print(f"skipped {name}: {why}", file=sys.stderr)
    return 0 if report["scenes"] else 1


if __name__ == "__main__":
    sys.exit(main())
