"""Networks from files: `.pt`, as training keeps them, and `.onnx`, as they are exported."""

from pathlib import Path

import onnx
import torch
from onnx import numpy_helper
from torch import nn

from .reference.unet import UNet, fold_batchnorm


def load_state(path: Path, device: torch.device | str = "cpu") -> dict:
    """What training keeps: `views`, the averaged weights `average`, `step`, `seconds`, `earlier`, `config`, `history`;
    while it runs also `net` and `optimiser`."""
    return torch.load(path, weights_only=True, map_location=device)


def trained_network(state: dict) -> UNet:
    """The network of a state, in inference mode, BatchNorm not folded."""
    net = UNet(state["views"]).eval()
    net.load_state_dict(state["average"])
    return net


def training_of(state: dict) -> str:
    """The trainings that a state went through, and what was fitted after them, in a line."""
    runs = [*state["earlier"], (state["views"], state["step"], state["seconds"])]
    told = ", then ".join(f"V = {v}: {steps:,} steps, {seconds / 60:.0f} minutes" for v, steps, seconds in runs)
    if "view_weights" in state["config"]:
        told += "; then view weights fitted to surface:1"
    if "logit_shift" in state["config"]:
        told += f"; then, after the last validation, logit 0 shifted by {state['config']['logit_shift']:g}"
    return told


def load_network(path: Path) -> UNet:
    """The network of either kind of file, float32, in inference mode, BatchNorm folded into its convolutions."""
    return exported_network(path) if path.suffix == ".onnx" else fold_batchnorm(trained_network(load_state(path)))


def model_card(model: onnx.ModelProto) -> dict[str, str]:
    """The card of an exported model."""
    return {p.key: p.value for p in model.metadata_props}


def exported_network(path: Path) -> UNet:
    """The network of a float32 model: all its weights are those of its convolutions."""
    model = onnx.load(path)
    weights = {i.name: torch.from_numpy(numpy_helper.to_array(i).copy()) for i in model.graph.initializer}
    convolutions = [node for node in model.graph.node if node.op_type == "Conv"]
    views = weights[convolutions[0].input[1]].shape[1] // 3
    net = UNet(views)
    for index, node in enumerate(convolutions, 1):
        weight = weights[node.input[1]]
        bias = weights[node.input[2]] if len(node.input) > 2 else torch.zeros(len(weight))  # the exporter drops zeros
        conv = nn.Conv2d(weight.shape[1], weight.shape[0], 3, 2 if index in (2, 3, 4) else 1, padding=1)
        conv.weight.data, conv.bias.data = weight, bias
        setattr(net, f"conv{index}", conv if index == 9 else nn.Sequential(conv, nn.ReLU()))
    return net.eval()
