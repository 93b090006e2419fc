"""The scores of a method on held-out targets, in a JSON that grows by a target at a time."""

import ast
import hashlib
import inspect
import json
import sys
from dataclasses import dataclass, replace
from errno import ENOENT
from pathlib import Path
from statistics import fmean
from types import ModuleType

import torch
from torch import Tensor, nn

from ..checkpoint import load_state
from ..data.held_out import BORDER, INNER
from ..evaluation import lpips as perceptual
from ..reference import unet, warp
from ..reference.geometry import plane_sweep
from ..reference.image import metrics
from ..reference.layers import cover, histogram
from ..reference.render import blend, composite_competing, renderer
from . import crops, mpi, rig, samples, scenes, shots, train, variants
from .method import Method
from .registry import Entry
from .results import COMPETING, mean, write
from .shots import window

SCALES = 0.5, 1.0, 2.0, 4.0, 8.0, 16.0
CODE = (
    mpi, rig, samples, scenes, shots, variants, blend, composite_competing, cover, histogram, metrics,
    plane_sweep, renderer, unet, warp, perceptual,
)  # fmt: skip


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
    """psnr (dB), ssim and lpips inside the border."""
    a, b = image.clamp(0, 1)[INNER], truth[INNER]
    found = {"psnr": metrics.psnr(a, b), "ssim": metrics.ssim(a, b)}
    if weights is not None:
        found["lpips"] = perceptual.lpips(weights, a, b)
    return {metric: round(value, 5) for metric, value in found.items()}


def code_digest(entry: Entry) -> str:
    """Of the code that decides an entry's scores, whatever its comments say."""
    own = inspect.getmodule(entry.build)
    methods = own.__name__.rsplit(".", 1)[0]
    used = {inspect.getmodule(value) for value in vars(own).values()}  # methods that this one is made of
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


def weights_key(entry: Entry) -> str:
    """The entry whose weights this one renders with."""
    return getattr(entry, "weights", None) or entry.key


def load(entry: Entry, runs: Path, samples: train.Samples) -> tuple[Method, dict]:
    """The method with its averaged weights, and what is told of them; BatchNorm's statistics are estimated anew, since
    training does so only where it validates. FileNotFoundError where it was not trained yet."""
    method = entry.build(entry.views)
    if not any(True for _ in method.parameters()):
        return method.eval(), {"step": None}
    path = runs / weights_key(entry) / "checkpoint.pt"
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
        train.estimate_statistics(method, batches, entry.training_planes)
    return method.eval(), about | {"history": state["history"]}


def fitted_scale(method: Method, entry: Entry, source: Source) -> dict[float, float]:
    """PSNR of each scale in the mean of the validation scenes' first targets, on the most planes; of the middle half of
    the width and the height of each, which is enough to tell one scale from another."""
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
    """Score an entry, from where it was left; `validation` is what the scale of planes that compete is fitted on."""
    path = out / f"{source.data}_{entry.key}.json"
    key = {"step": about["step"], "trained_on": source.trained_on, "code": code_digest(entry)}
    report = json.loads(path.read_text()) if path.exists() else {}
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
            if layers.startswith(f"planes:{max(entry.planes)}"):
                crops.keep(path, image, shot, competing=layers.endswith(COMPETING))
        report["targets"].append({"scene": shot.scene, "target": shot.target, "scores": found})
        report["mean"] = mean(report["targets"])
        write(path, report)
        best = max(found, key=lambda layers: found[layers]["psnr"])
        print(f"{entry.key} {shot.scene}/{shot.target}: {best} {found[best]['psnr']:.2f} dB", flush=True)
    return report
