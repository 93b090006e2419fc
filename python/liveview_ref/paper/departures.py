"""What single departures from the paper change, where that shows without another training: the same network with one of
them undone, or introduced where it was trained without, on the same targets.

    python -m liveview_ref.paper.departures --scenes FOLDER --textures FOLDER --out ../models/paper/departures.json

Networks: the shipped `liveview_v4` (independent planes, as in the paper), `liveview_v4_planes` (planes that compete),
and with --runs the one trained on the rig. Each on 64 planes, of the upper left quarter of a target, which has its
share of edges: scores inside 16 pixels at each side, and the PSNR of those 16 alone, where photos end and padding is
near. Kept after each target: run again, it goes on, and begins anew where the training's step or the code that decides
the scores is another."""

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean

import torch
import torch.nn.functional as F
from torch import Tensor

from ..checkpoint import load_state, trained_network
from ..data.held_out import INNER
from ..evaluation.view_weights import view_weights
from ..reference import unet
from ..reference.image.metrics import psnr
from ..reference.render import spacing
from ..reference.render.blend import blend
from .methods import liveview
from .methods.liveview import BATCH, nearest_first
from .mpi import over, padded, volume_at
from .registry import entry
from .results import write
from .samples import RigSamples
from .scenes import Scenes
from .scoring import CODE, Source, digest, load, scores_of
from .shots import Shot, window
from .variants import Planes, competing, independent

PLANES = 64
SPACING = 3.0  # pixels of parallax to the next plane that count, at most
MODELS = Path(__file__).parents[3] / "models"
AS_IT_IS = "as it is"


@dataclass(frozen=True)
class Network:
    """A network of four views, how its planes are composited, whether it takes photos nearest first, and the step of
    its training."""

    net: unet.UNet
    scale: float | None  # of planes that compete; None: independent
    nearest_first: bool
    step: int = 0


Blend = Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]  # logits, volume, coverage, distances -> rgb


def usual(logits: Tensor, volume: Tensor, coverage: Tensor, distances: Tensor) -> Tensor:
    return blend(logits, volume, coverage, distances)[1]


def without_coverage(logits: Tensor, volume: Tensor, coverage: Tensor, distances: Tensor) -> Tensor:
    """Every photo has its weight everywhere, and is black where it does not see."""
    weights = view_weights(logits, torch.ones_like(coverage), distances)
    return (weights[:, :, None] * volume).sum(1)


def without_zero_logit(logits: Tensor, volume: Tensor, coverage: Tensor, distances: Tensor) -> Tensor:
    """The V - 1 weights are of all photos but the first."""
    others = torch.cat([logits[:, :1], logits[:, 2:] - logits[:, 1:2]], 1)  # its softmax is that of logits 1 .. V - 1
    return blend(others, volume[:, 1:], coverage[:, 1:], distances[1:])[1]


def by_distance(power: float) -> Blend:
    return lambda *given: blend(*given, power)[1]


BLENDS: dict[str, Blend] = {
    AS_IT_IS: usual,
    "no normalisation by coverage": without_coverage,
    "no implicit zero logit: the first photo has no weight": without_zero_logit,
    "weights not divided by distance": by_distance(0.0),
    "weights divided by distance^1.5": by_distance(1.5),
}


@contextmanager
def upsampling(**how):
    """The network's upsampling in another way."""
    before = unet.upsample
    unet.upsample = lambda x: F.interpolate(x, scale_factor=2.0, **how)
    try:
        yield
    finally:
        unet.upsample = before


@torch.inference_mode()
def planes_of(network: Network, shot: Shot, blends: dict[str, Blend], zeros: bool = False) -> dict[str, Planes]:
    """The planes by each blend; `zeros`: what the padding beyond the target sees is black."""
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
    """With the photos nearest first, or in the rig's order, as they come."""
    return replace(shot, photos=nearest_first(shot.photos, shot.camera)) if nearest else shot


def switched(network: Network, shot: Shot) -> Iterator[tuple[str, Tensor]]:
    """(departure undone or introduced, image) of each, what is as it is first."""
    own = ordered(shot, network.nearest_first)
    made = planes_of(network, own, BLENDS)
    for name, planes in made.items():
        yield name, composited(network, planes)
    whole = made[AS_IT_IS]
    if network.scale is None:
        yield "the farthest plane not made opaque", over(whole.alpha, whole.rgb)
        shift = spacing.logit_shift(own.photos.cameras, own.camera, own.planes(PLANES), SPACING).float()[:, None, None]
        per_pixel = torch.sigmoid(whole.logit + shift) * whole.covered
        yield "opacity per pixel of parallax", independent(whole._replace(alpha=per_pixel))
        for scale in (1.0, 2.0):
            yield f"planes compete, scale {scale:g}", composited(replace(network, scale=scale), whole)
    else:
        yield "planes do not compete", composited(replace(network, scale=None), whole)

    def again(**how) -> Tensor:
        return composited(network, planes_of(network, own, {AS_IT_IS: usual}, **how)[AS_IT_IS])

    yield "padded by zeros", again(zeros=True)
    for name, how in {
        "upsampling that aligns corners": {"mode": "bilinear", "align_corners": True},
        "upsampling by the nearest": {"mode": "nearest"},
    }.items():
        with upsampling(**how):
            yield name, again()
    other = ordered(shot, not network.nearest_first)
    order = "photos nearest first" if not network.nearest_first else "photos in the rig's order"
    yield order, composited(network, planes_of(network, other, {AS_IT_IS: usual})[AS_IT_IS])
    network.net.train()  # running statistics move: they are put back
    state = {name: value.clone() for name, value in network.net.state_dict().items()}
    yield "BatchNorm by the statistics of a batch of planes", again()
    network.net.load_state_dict(state)
    network.net.eval()


def networks(runs: Path | None, training: Scenes) -> dict[str, Network]:
    found = {}
    for name, scale in (("liveview_v4", None), ("liveview_v4_planes", 1.0)):
        state = load_state(MODELS / f"{name}.pt")
        found[name] = Network(trained_network(state), scale, True, state["step"])
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
    """Of each departure: mean scores, and the difference in dB to what is as it is, inside the border and there."""
    out = {}
    for name in targets[0]["scores"]:
        row = {m: round(fmean(t["scores"][name][m] for t in targets), 5) for m in targets[0]["scores"][name]}
        for part in ("", "border_"):
            row[f"{part}difference"] = round(row[f"{part}psnr"] - out.get(AS_IT_IS, row)[f"{part}psnr"], 5)
        out[name] = row
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=Path, required=True, help="folder of the rig's scenes")
    parser.add_argument("--textures", type=Path, required=True, help="folder of photos to paint the rig's scenes with")
    parser.add_argument("--runs", type=Path, help="what training wrote: adds the network trained on the rig")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--limit", type=int, default=10**6, help="scenes at most")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    report = json.loads(args.out.read_text()) if args.out.exists() else {}
    code = digest([*CODE, spacing, liveview, sys.modules[__name__]])
    for name, network in networks(args.runs, Scenes(args.scenes, args.textures, "train")).items():
        key = {"step": network.step, "code": code}
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
            print(f"{name} {shot.scene}: {found[AS_IT_IS]['psnr']:.2f} dB", flush=True)


if __name__ == "__main__":
    main()
