"""Fit two factors of a network's view weights to surface layers: of its constant preference among
the views, and of the part that varies with the image. They are folded into the last layer, so that
the architecture stays the paper's.

    python -m liveview_ref.training.fit_view_weights START.pt OUT.pt --frames FOLDER

A network trained only on guided layers prefers the nearer views by a constant in addition to their
distances, which matter more on surface layers. The frames are those of data/surface_frames.py, made
from train/.
"""

import argparse
from itertools import product
from pathlib import Path
from statistics import fmean

import torch
import torch.nn.functional as F
from torch import Tensor

from ..checkpoint import load_state, trained_network
from ..data.held_out import INNER
from ..data.surface_frames import SurfaceFrame
from ..reference.image.metrics import psnr
from ..reference.unet import UNet
from .fine_tune import save
from .surface_loss import rendered

CONSTANT = 1.0, 0.75, 0.5, 0.25, 0.0
VARYING = 1.0, 0.7, 0.4


@torch.inference_mode()
def first_layer(net: UNet, frame: SurfaceFrame) -> tuple[Tensor, Tensor, Tensor]:
    """Logits [1, V, H, W], colour [1, V, 3, H, W] and coverage [1, V, H, W] of a frame's first
    layer."""
    colour, coverage = frame.colour[:1] / 255, frame.coverage[:1] / 255
    height, width = coverage.shape[2:]
    hwv = F.pad(colour.flatten(1, 2), [0, -width % 8, 0, -height % 8], "replicate")
    return net(hwv)[..., :height, :width], colour, coverage


@torch.inference_mode()
def fit(net: UNet, frames: list[Path]) -> tuple[float, float, Tensor]:
    """(constant, varying) of the best mean PSNR over the frames, and the mean logits [V - 1]
    of the views."""
    means = torch.stack([first_layer(net, SurfaceFrame.load(path))[0][0, 1:].mean((1, 2)) for path in frames])
    mean = means.mean(0)
    scores = {shares: [] for shares in product(CONSTANT, VARYING)}
    for frame in map(SurfaceFrame.load, frames):
        logits, colour, coverage = first_layer(net, frame)
        for constant, varying in scores:
            changed = logits.clone()
            changed[:, 1:] = varying * (logits[:, 1:] - mean[:, None, None]) + constant * mean[:, None, None]
            image = rendered(changed, colour, coverage, frame.distances)
            scores[constant, varying].append(psnr(image[INNER], (frame.target / 255)[INNER]))
    for (constant, varying), each in scores.items():
        print(f"constant {constant}, varying {varying}: {fmean(each):.3f} dB", flush=True)
    return *max(scores, key=lambda shares: fmean(scores[shares])), mean


def fold(state: dict, constant: float, varying: float, mean: Tensor) -> None:
    """Fold the factors into the last layer of the state's weights, and record them in its
    config."""
    weight, bias = state["average"]["conv9.weight"], state["average"]["conv9.bias"]
    weight[1:] *= varying
    bias[1:] = varying * bias[1:] + (constant - varying) * mean
    state["config"] = state["config"] | {"view_weights": {"constant": constant, "varying": varying}}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("start", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument(
        "--frames", type=Path, required=True, nargs="+", help="folders of frames with the same number of views"
    )
    args = parser.parse_args()
    torch.set_num_threads(1)
    frames = sorted(path for folder in args.frames for path in folder.glob("*.pt"))
    if not frames:
        parser.error(f"--frames {args.frames[0]}: no frames; expected those of liveview_ref.data.surface_frames")
    state = load_state(args.start)
    constant, varying, mean = fit(trained_network(state), frames)
    print(f"mean logits {[round(float(x), 2) for x in mean]}; constant {constant}, varying {varying}")
    fold(state, constant, varying, mean)
    save(args.out, **state)


if __name__ == "__main__":
    main()
