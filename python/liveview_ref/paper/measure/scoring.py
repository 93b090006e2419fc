"""The scores of a method on held-out targets, kept in a JSON file that is written
after each target."""

import ast
import hashlib
import inspect
import sys
from dataclasses import dataclass, replace
from errno import ENOENT
from pathlib import Path
from statistics import fmean
from types import ModuleType

import torch
from torch import Tensor, nn

from liveview_ref.checkpoint import load_state
from liveview_ref.data.held_out import BORDER, INNER
from liveview_ref.evaluation import lpips as perceptual
from liveview_ref.reference import competing, liveview, metrics
from liveview_ref.reference import layers as layer_maps

from .. import train
from ..data import rig, samples, scenes, shots
from ..data.shots import window
from ..files import read, write
from ..methods import mpi
from ..methods.method import Method
from ..methods.registry import Entry
from . import crops, variants
from .means import mean
from .variants import COMPETING

SCALES = 0.5, 1.0, 2.0, 4.0, 8.0, 16.0
CODE = (
    mpi, rig, samples, scenes, shots, variants, competing, layer_maps, liveview, metrics, perceptual,
)  # fmt: skip


@dataclass
class Source:
    """Where targets come from, and where the crops of the report's figure go."""

    data: str
    folder: Path
    textures: Path
    scenes: int
    targets: int
    trained_on: str = "rig"
    crops: Path | None = None

    def shots(self, split: str, views: int):
        return shots.shots(self.data, self.folder, self.textures, split, views, self.scenes, self.targets)


def scores_of(image: Tensor, truth: Tensor, weights) -> dict[str, float]:
    """psnr (dB), ssim and lpips (if `weights` are given) inside the border."""
    a, b = image.clamp(0, 1)[INNER], truth[INNER]
    found = {"psnr": metrics.psnr(a, b), "ssim": metrics.ssim(a, b)}
    if weights is not None:
        found["lpips"] = perceptual.lpips(weights, a, b)
    return {metric: round(value, 5) for metric, value in found.items()}


def code_digest(entry: Entry) -> str:
    """Digest of the code that determines an entry's scores, without its comments."""
    own = inspect.getmodule(entry.build)
    methods = own.__name__.rsplit(".", 1)[0]
    used = {inspect.getmodule(value) for value in vars(own).values()}  # the methods that it builds on
    used = sorted({m for m in used if m and m.__name__.startswith(methods)} | {own}, key=lambda m: m.__name__)
    return digest([*CODE, sys.modules[__name__], *used])


def digest(modules: list[ModuleType]) -> str:
    return hashlib.sha256("".join(meaning(inspect.getsource(m)) for m in modules).encode()).hexdigest()[:16]


def meaning(source: str) -> str:
    """A module's syntax without documentation, comments and layout."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [n for n in body if not (isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant))]
    return ast.dump(tree)


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
    if any(isinstance(m, nn.modules.batchnorm._BatchNorm) for m in method.modules()):
        last = state["step"] * train.BATCH
        numbers = [(last - 1 - n) % last for n in range(train.STATISTICS * train.BATCH)]
        drawn = [samples(entry.views, n) for n in numbers]
        batches = [drawn[i : i + train.BATCH] for i in range(0, len(drawn), train.BATCH)]
        train.estimate_statistics(method, batches, entry.planes_of(state))
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
    key = {"step": about["step"], "trained_on": source.trained_on, "code": code_digest(entry)}
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
            if source.crops and layers.startswith(f"planes:{max(entry.planes)}"):
                suffix = "_competing" if layers.endswith(COMPETING) else ""
                crops.keep(source.crops, f"{entry.key}{suffix}", image, shot)
        report["targets"].append({"scene": shot.scene, "target": shot.target, "scores": found})
        report["mean"] = mean(report["targets"])
        write(path, reports | {entry.key: report})
        best = max(found, key=lambda layers: found[layers]["psnr"])
        print(f"{entry.key} {shot.scene}/{shot.target}: {best} {found[best]['psnr']:.2f} dB", flush=True)
    return report
