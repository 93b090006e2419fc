"""Export a checkpoint to ONNX: python -m liveview_ref.export CHECKPOINT MODEL.onnx CONFIG

One file, opset 20, dynamic n, h and w, BatchNorm folded, metadata for the runtime; then checked: torch = onnxruntime
at batch sizes and image sizes that it was not exported with.
"""

import argparse
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch

from .layers import STRIDE
from .unet import UNet, fold_batchnorm

TOLERANCE = 1e-5  # of the largest logit: float32 sums of up to 1,728 products in another order; 7e-7 was seen
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
        opset_version=20,
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


def check(net: UNet, path: Path) -> float:
    """Largest departure of onnxruntime from torch over CHECKED, relative to the logits' largest magnitude."""
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    worst = 0.0
    generator = torch.Generator().manual_seed(0)
    for n, height, width in CHECKED:
        hwv = torch.rand(n, 3 * net.views, height, width, generator=generator)
        with torch.no_grad():
            expected = net.eval()(hwv).numpy()
        (found,) = session.run(["logits"], {"hwv": hwv.numpy()})
        assert found.shape == expected.shape == (n, net.views, height, width), (found.shape, expected.shape)
        worst = max(worst, float(np.abs(found - expected).max() / np.abs(expected).max()))
    if worst > TOLERANCE:
        raise ValueError(
            f"{path}: onnxruntime departs from torch by {worst:.2e} of the logits (at most {TOLERANCE:.0e})"
        )
    return worst


def trained_layers(config: dict) -> str:
    guided, planes = ([min(x), max(x)] for x in (config["guided_layers"], config["uniform_planes"]))
    if config.get("alpha") == "competing":
        return "uniform planes {}-{}".format(*planes)
    return "guided {}-{}, uniform planes {}-{}".format(*guided, *planes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("model", type=Path)
    parser.add_argument("--recommended-layers", default="guided 2")
    parser.add_argument("--licence", required=True, help="of the weights and of what they were trained on, in a line")
    args = parser.parse_args()
    state = torch.load(args.checkpoint, weights_only=True)
    net = UNet(state["views"]).eval()
    net.load_state_dict(state["average"])
    config = state["config"]
    runs = [*state["earlier"], (state["views"], state["step"], state["seconds"])]
    told = ", then ".join(f"V = {views}: {steps} steps, {seconds / 60:.0f} minutes" for views, steps, seconds in runs)
    metadata = {
        "recommended_layers": args.recommended_layers,
        "training": f"batches of {config['batch']} scenes; {told}",
        "trained_layers": trained_layers(config),
        "licence": args.licence,
    }
    if config.get("alpha") == "competing":  # the scale that logit 0 is to be multiplied by: trained with as it is
        metadata |= {"alpha": "competing", "alpha_scale": "1"}
    export(net, args.model, metadata)
    kept = ("average", "views", "step", "seconds", "earlier", "config", "history")
    torch.save({key: state[key] for key in kept}, args.model.with_suffix(".pt"))
    print(f"{args.model}: {args.model.stat().st_size / 1e6:.2f} MB, departs from torch by {check(net, args.model):.1e}")


if __name__ == "__main__":
    main()
