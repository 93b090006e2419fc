"""Export a checkpoint to ONNX.

    python -m liveview_ref.export CHECKPOINT MODEL.onnx --licence TEXT

One file, opset 20, dynamic n, h and w, BatchNorm folded, with metadata for the Rust crate:
views, stride, recommended_layers, training, trained_layers, licence; layer_kinds if it is for
some kinds of layers only; alpha and alpha_scale if it was trained on competing layers; added_to if
its logits include those of the views' agreement. The result is checked: torch = onnxruntime at
batch sizes and image sizes other than those of the export. The record of the training goes to
training.json beside it.
"""

import argparse
import warnings
from pathlib import Path
from typing import BinaryIO

import numpy as np
import onnx
import torch
from torch import Tensor, nn

from . import layer_spec
from .checkpoint import load_network, load_state, record, trained_network, training_of
from .onnx_session import logits, session
from .reference.liveview import STRIDE, UNet
from .weights import fold_batchnorm, unfold_batchnorm, with_views

OPSET = 20  # the first with GridSample's modes under the names that torch exports
TOLERANCE = 1e-5  # of the largest logit: float32 sums of up to 1,728 products in another order
CHECKED_SHAPES = [(1, 8, 8), (3, 56, 72), (5, 24, 200), (2, 352, 504)]


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
    """Export any module by tracing it with these inputs; `names` as torch.onnx.export takes
    them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # they warn that the trace is valid only for inputs like these, as intended
        torch.onnx.export(module, inputs, to, dynamo=False, opset_version=OPSET, **names)


def check(net: UNet, path: Path) -> float:
    """Largest difference of onnxruntime from torch over CHECKED_SHAPES, relative to
    the largest logit."""
    network = session(path)
    worst = 0.0
    generator = torch.Generator().manual_seed(0)
    for n, height, width in CHECKED_SHAPES:
        hwv = torch.rand(n, 3 * net.views, height, width, generator=generator)
        with torch.no_grad():
            expected = net.eval()(hwv).numpy()
        found = logits(network, hwv.numpy())
        assert found.shape == expected.shape == (n, net.views, height, width), (found.shape, expected.shape)
        worst = max(worst, float(np.abs(found - expected).max() / np.abs(expected).max()))
    if worst > TOLERANCE:
        found = f"onnxruntime differs from torch by {worst:.2e} of the largest logit"
        raise ValueError(f"{path}: {found}; expected at most {TOLERANCE:.0e}")
    return worst


def mean_network(net: UNet, other: UNet) -> UNet:
    """The network of the mean weights of two; `other` with BatchNorm folded."""
    mean, others = fold_batchnorm(net), other.state_dict()
    mean.load_state_dict({name: (weights + others[name]) / 2 for name, weights in mean.state_dict().items()})
    return unfold_batchnorm(mean)


def trained_layers(config: dict) -> str:
    """The layers that a config trains on, as in the metadata of a model."""
    guided, planes = ([min(x), max(x)] for x in (config["guided_layers"], config["uniform_planes"]))
    if "frames" in config:
        return f"surface:{config['layers']}"
    if "shards" in config:
        return "planes:{} to planes:{}".format(*planes)
    return "guided:{} to guided:{}, planes:{} to planes:{}".format(*guided, *planes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("model", type=Path)
    parser.add_argument(
        "--recommended-layers", type=layer_spec.argument, default="surface:1", help="such as %(default)s or planes:64"
    )
    kinds = ("planes", "guided", "surface", "select", "list")
    parser.add_argument(
        "--layer-kinds", nargs="+", choices=kinds, default=[], help="kinds of layers it is for; default: all"
    )
    parser.add_argument("--logit-shift", type=float, default=0.0, help="added to logit 0 in the last layer")
    parser.add_argument(
        "--view-shift",
        nargs=2,
        type=float,
        metavar=("SHIFT", "FIRST"),
        help="add SHIFT to the logits of the views from the FIRST on (2 or more) in the last layer",
    )
    parser.add_argument("--share", type=float, default=1.0, help="of what it adds to the views' agreement")
    parser.add_argument(
        "--mean-with-start",
        type=Path,
        metavar="MODEL",
        help="export the mean of the weights and those of MODEL, which the training started from",
    )
    parser.add_argument("--licence", required=True, help="of the weights and of the training data, in one line")
    args = parser.parse_args()
    state = load_state(args.checkpoint)
    if args.logit_shift:
        state["average"]["conv9.bias"][0] += args.logit_shift
        state["config"]["logit_shift"] = args.logit_shift
    if args.share != 1.0:
        for name in ("conv9.weight", "conv9.bias"):
            state["average"][name] *= args.share
        state["config"]["share"] = args.share
    net, config = trained_network(state), state["config"]
    if args.mean_with_start:
        net = mean_network(net, with_views(load_network(args.mean_with_start), net.views))
        config["mean_with_start"] = True
    if args.view_shift:
        shift, first = args.view_shift[0], int(args.view_shift[1])
        if not 2 <= first <= net.views:
            parser.error(f"--view-shift: FIRST is {first}; expected 2 to {net.views}: the nearest view has no logit")
        net.conv9.bias.data[first - 1 :] += shift
        config["view_shift"] = [shift, first]
    metadata = {
        "recommended_layers": str(args.recommended_layers),
        "training": f"batches of {config['batch']} scenes; {training_of(state)}",
        "trained_layers": trained_layers(config),
        "licence": args.licence,
    }
    if args.layer_kinds:
        metadata["layer_kinds"] = ", ".join(args.layer_kinds)
    if config.get("alpha") == "competing":  # the factor of logit 0: 1, as in training
        metadata |= {"alpha": "competing", "alpha_scale": "1"}
    if config.get("agreement"):
        metadata["added_to"] = "view agreement"
    export(net, args.model, metadata)
    record(state, args.model)
    size = args.model.stat().st_size / 1e6
    print(f"{args.model}: {size:.2f} MB, differs from torch by {check(net, args.model):.1e}")


if __name__ == "__main__":
    main()
