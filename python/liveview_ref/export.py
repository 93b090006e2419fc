"""Export a checkpoint to ONNX: python -m liveview_ref.export CHECKPOINT MODEL.onnx --licence TEXT

One file, opset 20, dynamic n, h and w, BatchNorm folded, with metadata for the Rust crate: views, stride,
recommended_layers, training, trained_layers, licence; of a model for some kinds of layers alone layer_kinds, of one
trained on competing layers alpha and alpha_scale, and of one whose opacity is per pixel of parallax alpha_spacing. Then
checked: torch = onnxruntime at batch sizes and image sizes that it was not exported with. The checkpoint without the
optimiser is written beside it, as MODEL.pt.
"""

import argparse
import warnings
from pathlib import Path
from typing import BinaryIO

import numpy as np
import onnx
import torch
from torch import Tensor, nn

from .checkpoint import load_state, trained_network, training_of
from .onnx_session import logits, session
from .reference.layers import spec as layer_spec
from .reference.layers.cells import STRIDE
from .reference.unet import UNet, fold_batchnorm

OPSET = 20  # GridSample came with 16, and with 20 took the names of its modes that torch exports
TOLERANCE = 1e-5  # of the largest logit: float32 sums of up to 1,728 products in another order
CHECKED = [(1, 8, 8), (3, 56, 72), (5, 24, 200), (2, 352, 504)]


def export(net: UNet, path: Path, metadata: dict[str, str]) -> None:
    """Write `net` (in inference mode, float32) to `path`."""
    folded = fold_batchnorm(net)
    dynamic = {0: torch.export.Dim("n"), 2: STRIDE * torch.export.Dim("h8"), 3: STRIDE * torch.export.Dim("w8")}
    program = torch.onnx.export(
        folded,
        (torch.rand(2, 3 * net.views, 64, 96),),
        dynamo=True,
        input_names=["hwv"],
        output_names=["logits"],
        dynamic_shapes=(dynamic,),
        opset_version=OPSET,
        verbose=False,
    )
    model = program.model_proto
    for key, value in {"views": str(net.views), "stride": str(STRIDE), **metadata}.items():
        model.metadata_props.add(key=key, value=value)
    for node in model.graph.node:
        del node.metadata_props[:]  # source lines of the machine that exported
        node.doc_string = ""
    for value in [*model.graph.value_info, *model.graph.initializer, model.graph]:
        del value.metadata_props[:]
    onnx.checker.check_model(model, full_check=True)
    temporary = path.with_suffix(".tmp")
    onnx.save(model, temporary)
    temporary.rename(path)


def export_traced(module: nn.Module, inputs: tuple[Tensor, ...], to: Path | BinaryIO, **names) -> None:
    """Export any module by tracing it with these inputs; `names` as torch.onnx.export takes them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # they warn that the trace holds for inputs like these alone, as it is meant to
        torch.onnx.export(module, inputs, to, dynamo=False, opset_version=OPSET, **names)


def check(net: UNet, path: Path) -> float:
    """Largest departure of onnxruntime from torch over CHECKED, relative to the logits' largest magnitude."""
    network = session(path)
    worst = 0.0
    generator = torch.Generator().manual_seed(0)
    for n, height, width in CHECKED:
        hwv = torch.rand(n, 3 * net.views, height, width, generator=generator)
        with torch.no_grad():
            expected = net.eval()(hwv).numpy()
        found = logits(network, hwv.numpy())
        assert found.shape == expected.shape == (n, net.views, height, width), (found.shape, expected.shape)
        worst = max(worst, float(np.abs(found - expected).max() / np.abs(expected).max()))
    if worst > TOLERANCE:
        raise ValueError(
            f"{path}: onnxruntime departs from torch by {worst:.2e} of the logits (at most {TOLERANCE:.0e})"
        )
    return worst


def trained_layers(config: dict) -> str:
    """What layers a config trains on, as the card of a model tells."""
    guided, planes = ([min(x), max(x)] for x in (config["guided_layers"], config["uniform_planes"]))
    if "shards" in config:
        return "planes:{} to planes:{}".format(*planes)
    if "frames" in config:
        return f"surface:1, surface:{config['layers']}"
    return "guided:{} to guided:{}, planes:{} to planes:{}".format(*guided, *planes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("model", type=Path)
    parser.add_argument(
        "--recommended-layers", type=layer_spec.argument, default="surface:1", help="such as %(default)s or planes:64"
    )
    kinds = ("planes", "guided", "surface", "select", "list")
    parser.add_argument("--layer-kinds", nargs="+", choices=kinds, default=[], help="what it is for; all if left out")
    told = "added to logit 0, folded into the last layer: what a choice among shifts on held-out photos has given"
    parser.add_argument("--logit-shift", type=float, default=0.0, help=told)
    parser.add_argument("--licence", required=True, help="of the weights and of what they were trained on, in a line")
    args = parser.parse_args()
    state = load_state(args.checkpoint)
    if args.logit_shift:
        state["average"]["conv9.bias"][0] += args.logit_shift
        state["config"]["logit_shift"] = args.logit_shift
    net, config = trained_network(state), state["config"]
    metadata = {
        "recommended_layers": str(args.recommended_layers),
        "training": f"batches of {config['batch']} scenes; {training_of(state)}",
        "trained_layers": trained_layers(config),
        "licence": args.licence,
    }
    if args.layer_kinds:
        metadata["layer_kinds"] = ", ".join(args.layer_kinds)
    if config.get("alpha") == "competing":  # the scale that logit 0 is to be multiplied by: trained with as it is
        metadata |= {"alpha": "competing", "alpha_scale": "1"}
    if config.get("alpha_spacing"):
        metadata["alpha_spacing"] = str(config["alpha_spacing"])
    export(net, args.model, metadata)
    kept = ("average", "views", "step", "seconds", "earlier", "config", "history")
    torch.save({key: state[key] for key in kept}, args.model.with_suffix(".pt"))
    print(f"{args.model}: {args.model.stat().st_size / 1e6:.2f} MB, departs from torch by {check(net, args.model):.1e}")


if __name__ == "__main__":
    main()
