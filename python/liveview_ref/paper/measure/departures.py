"""The effect of single departures from the paper, where it shows without another training: the same
network on the same targets, with one departure undone, or introduced if it was trained without.

    python -m liveview_ref.paper.measure.departures --scenes DIR --textures DIR --out FILE.json

Networks: the shipped `liveview_v4` (independent planes, as in the paper), `liveview_v4_planes`
(competing planes), and with --runs the one trained on the rig. Each renders the upper left quarter
of a target, which contains enough edges, on 64 planes: scores without a border of 16 pixels, and
the PSNR of that border alone, where photos end and padding is near. Written after each target; a
second run continues, and begins again with a network whose training has gone on."""

import argparse
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from liveview_ref.checkpoint import load_state, trained_network
from liveview_ref.data.held_out import INNER
from liveview_ref.data.visibility import view_weights
from liveview_ref.paths import MODELS
from liveview_ref.reference.liveview import UNet, blend
from liveview_ref.reference.metrics import psnr

from ..data.samples import RigSamples
from ..data.scenes import Scenes
from ..data.shots import Shot, window
from ..files import write
from ..methods.liveview import BATCH, nearest_first
from ..methods.mpi import over, padded, volume_at
from ..methods.registry import entry
from .score import Source, load, scores_of
from .variants import Planes, competing, independent

PLANES = 64
UNCHANGED = "unchanged"


@dataclass(frozen=True)
class Network:
    """A network of four views, how its planes are composited, whether it takes photos nearest
    first, and the step of its training."""

    net: UNet
    scale: float | None  # of competing planes; None: independent planes
    nearest_first: bool
    step: int = 0


Blend = Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]  # logits, volume, coverage, distances -> rgb


def usual(logits: Tensor, volume: Tensor, coverage: Tensor, distances: Tensor) -> Tensor:
    return blend(logits, volume, coverage, distances)[1]


def without_coverage(logits: Tensor, volume: Tensor, coverage: Tensor, distances: Tensor) -> Tensor:
    """Every photo keeps its weight everywhere, and is black where it does not cover."""
    weights = view_weights(logits, torch.ones_like(coverage), distances)
    return (weights[:, :, None] * volume).sum(1)


def without_zero_logit(logits: Tensor, volume: Tensor, coverage: Tensor, distances: Tensor) -> Tensor:
    """The V - 1 weights belong to all photos but the first."""
    others = torch.cat([logits[:, :1], logits[:, 2:] - logits[:, 1:2]], 1)  # its softmax is that of logits 1 .. V - 1
    return blend(others, volume[:, 1:], coverage[:, 1:], distances[1:])[1]


def by_distance(power: float) -> Blend:
    return lambda *given: blend(*given, power)[1]


BLENDS: dict[str, Blend] = {
    UNCHANGED: usual,
    "no normalisation by coverage": without_coverage,
    "no implicit zero logit: the first photo has no weight": without_zero_logit,
    "weights not divided by distance": by_distance(0.0),
    "weights divided by distance^1.5": by_distance(1.5),
}


@contextmanager
def upsampling(**how):
    """Replace the network's upsampling."""
    before = nn.Upsample.forward
    nn.Upsample.forward = lambda _, x: F.interpolate(x, scale_factor=2.0, **how)
    try:
        yield
    finally:
        nn.Upsample.forward = before


@torch.inference_mode()
def planes_of(network: Network, shot: Shot, blends: dict[str, Blend], zeros: bool = False) -> dict[str, Planes]:
    """The planes by each blend; `zeros`: the padding beyond the target is black."""
    camera, parts = padded(shot.camera), {name: [] for name in blends}
    crop = (..., slice(shot.camera.height), slice(shot.camera.width))
    for some in shot.planes(PLANES).split(BATCH):
        volume, coverage, distances = volume_at(camera, shot.photos, some)
        if zeros:
            for x in (volume, coverage):
                x[..., shot.camera.width :] = 0
                x[..., shot.camera.height :, :] = 0
        logits = network.net(volume.flatten(1, 2))
        seen = (coverage > 0).any(1)
        for name, blended in blends.items():
            rgb = blended(logits, volume, coverage, distances)
            parts[name].append([x[crop] for x in (torch.sigmoid(logits[:, 0]) * seen, rgb, logits[:, 0], seen)])
    return {name: Planes(*(torch.cat(x) for x in zip(*rows, strict=True))) for name, rows in parts.items()}


def composited(network: Network, planes: Planes) -> Tensor:
    return independent(planes) if network.scale is None else competing(planes, network.scale)[0]


def ordered(shot: Shot, nearest: bool) -> Shot:
    """With the photos nearest first, or in the rig's order."""
    return replace(shot, photos=nearest_first(shot.photos, shot.camera)) if nearest else shot


def switched(network: Network, shot: Shot) -> Iterator[tuple[str, Tensor]]:
    """(departure undone or introduced, image); first the unchanged network."""
    own = ordered(shot, network.nearest_first)
    made = planes_of(network, own, BLENDS)
    for name, planes in made.items():
        yield name, composited(network, planes)
    whole = made[UNCHANGED]
    if network.scale is None:
        yield "farthest plane not opaque", over(whole.alpha, whole.rgb)
        for scale in (1.0, 2.0):
            yield f"competing planes, scale {scale:g}", composited(replace(network, scale=scale), whole)
    else:
        yield "independent planes", composited(replace(network, scale=None), whole)

    def again(**how) -> Tensor:
        return composited(network, planes_of(network, own, {UNCHANGED: usual}, **how)[UNCHANGED])

    yield "padded with zeros", again(zeros=True)
    for name, how in {
        "upsampling with aligned corners": {"mode": "bilinear", "align_corners": True},
        "nearest-neighbour upsampling": {"mode": "nearest"},
    }.items():
        with upsampling(**how):
            yield name, again()
    other = ordered(shot, not network.nearest_first)
    order = "photos nearest first" if not network.nearest_first else "photos in the rig's order"
    yield order, composited(network, planes_of(network, other, {UNCHANGED: usual})[UNCHANGED])
    network.net.train()  # changes the running statistics, which are restored
    state = {name: value.clone() for name, value in network.net.state_dict().items()}
    yield "BatchNorm with the statistics of a batch of planes", again()
    network.net.load_state_dict(state)
    network.net.eval()


def networks(runs: Path | None, training: Scenes) -> dict[str, Network]:
    found = {}
    for file, scale in (("liveview_v4.pt", None), ("liveview_v4_planes.onnx", 1.0)):
        state = load_state(MODELS / file)
        found[Path(file).stem] = Network(trained_network(state), scale, True, state["step"])
    if runs and (runs / "liveview_v4" / "checkpoint.pt").exists():
        method, about = load(entry("liveview_v4"), runs, RigSamples(training))
        found["liveview_v4 trained on the rig"] = Network(method.predictor.net, None, False, about["step"])
    return found


def scores_with_border(image: Tensor, truth: Tensor) -> dict[str, float]:
    """Scores inside the border, and `border_psnr` (dB) of the border alone."""
    border = torch.ones(truth.shape[1:], dtype=torch.bool)
    border[INNER] = False
    at_border = psnr(image.clamp(0, 1)[:, border], truth[:, border])
    return scores_of(image, truth, None) | {"border_psnr": round(at_border, 5)}


def summary(targets: list[dict]) -> dict[str, dict[str, float]]:
    """Of each departure: mean scores, and the difference in dB to the unchanged network, inside the
    border and at it."""
    out = {}
    for name in targets[0]["scores"]:
        row = {m: round(fmean(t["scores"][name][m] for t in targets), 5) for m in targets[0]["scores"][name]}
        for part in ("", "border_"):
            row[f"{part}difference"] = round(row[f"{part}psnr"] - out.get(UNCHANGED, row)[f"{part}psnr"], 5)
        out[name] = row
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=Path, required=True, help="folder of the rig's scenes")
    parser.add_argument("--textures", type=Path, required=True, help="folder of photos to paint the rig's scenes with")
    parser.add_argument("--runs", type=Path, help="the output of training: adds the network trained on the rig")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--limit", type=int, default=10**6, help="most scenes")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    report = json.loads(args.out.read_text()) if args.out.exists() else {}
    for name, network in networks(args.runs, Scenes(args.scenes, args.textures, "train")).items():
        key = {"step": network.step}
        if report.get(name, {}).get("key") != key:
            report[name] = {"planes": PLANES, "key": key, "targets": []}
        own = report[name]
        done = {target["scene"] for target in own["targets"]}
        for shot in Source("rig", args.scenes, args.textures, args.limit, 1).shots("test", 4):
            if shot.scene in done:
                continue
            quarter = window(shot, 0, 0, shot.camera.width // 2, shot.camera.height // 2)
            found = {what: scores_with_border(image, quarter.truth) for what, image in switched(network, quarter)}
            own["targets"].append({"scene": shot.scene, "scores": found})
            own["mean"] = summary(own["targets"])
            write(args.out, report)
            print(f"{name} {shot.scene}: {found[UNCHANGED]['psnr']:.2f} dB", flush=True)


if __name__ == "__main__":
    main()
