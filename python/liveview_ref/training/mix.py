"""The mean of the weights of a network and of its fine-tuned version: less gain by the fine-tuning,
and less loss elsewhere (Wortsman et al., "Robust fine-tuning of zero-shot models", 2022).

    python -m liveview_ref.training.mix START.pt TRAINED.pt OUT.pt --share 0.6
"""

import argparse
from pathlib import Path

import torch

from ..checkpoint import load_state, trained_network
from ..reference.unet import UNet, fold_batchnorm, unfold_batchnorm
from .fine_tune import save

COPIED = "views", "step", "seconds", "earlier", "config", "history"


def mixed(start: UNet, trained: UNet, share: float) -> UNet:
    """The mean with weight `share` of the trained network; both with BatchNorm folded."""
    with torch.no_grad():
        for own, other in zip(start.parameters(), trained.parameters(), strict=True):
            own.lerp_(other, share)
    return start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("start", type=Path)
    parser.add_argument("trained", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--share", type=float, required=True, help="of the trained weights, 0 to 1")
    args = parser.parse_args()
    start, trained = load_state(args.start), load_state(args.trained)
    if start["views"] != trained["views"]:
        parser.error(f"{args.start} has {start['views']} views, {args.trained} {trained['views']}; expected the same")
    if not 0 <= args.share <= 1:
        parser.error(f"--share {args.share}: expected 0 to 1")
    net = mixed(*(fold_batchnorm(trained_network(state)) for state in (start, trained)), args.share)
    state = {key: trained[key] for key in COPIED}
    state["config"] = state["config"] | {"share": args.share}
    save(args.out, average=unfold_batchnorm(net).state_dict(), **state)


if __name__ == "__main__":
    main()
