"""Networks from files: `.pt`, a checkpoint of training, and `.onnx`, an exported model."""

import json
from pathlib import Path

import onnx
import torch
from onnx import numpy_helper
from torch import nn

from .reference.liveview import UNet
from .reference.view_agreement import AgreementUNet
from .weights import fold_batchnorm, unfold_batchnorm

RECORDS = "training.json"  # beside exported models: how each was trained, by the stem of its file
RECORDED = "views", "step", "seconds", "earlier", "config", "history"


def load_state(path: Path, device: torch.device | str = "cpu") -> dict:
    """The state of a training: `views`, the averaged weights `average`, `step`, `seconds`,
    `earlier`, `config`, `history`; during training also `net` and `optimiser`. An exported model
    has identity BatchNorms, and only the fields of its record."""
    if path.suffix == ".onnx":
        net = exported_network(path)
        return {"average": unfold_batchnorm(net).state_dict(), "views": net.views} | records(path.parent).get(
            path.stem, {}
        )
    return torch.load(path, weights_only=True, map_location=device)


def records(folder: Path) -> dict[str, dict]:
    """How the models in a folder were trained."""
    path = folder / RECORDS
    return json.loads(path.read_text()) if path.exists() else {}


def record(state: dict, model: Path) -> None:
    """Add the training of a model to the records beside it."""
    found = records(model.parent) | {model.stem: {key: state[key] for key in RECORDED}}
    (model.parent / RECORDS).write_text(json.dumps(found, indent=1) + "\n")


def trained_network(state: dict) -> UNet:
    """The network of a state, in inference mode, BatchNorm not folded."""
    kind = AgreementUNet if state.get("config", {}).get("agreement") else UNet
    net = kind(state["views"]).eval()
    net.load_state_dict(state["average"])
    return net


def training_of(state: dict) -> str:
    """The successive trainings of a state, and later fits, in one line."""
    runs = [*state["earlier"], (state["views"], state["step"], state["seconds"])]
    text = ", then ".join(f"V = {v}: {steps:,} steps, {seconds / 60:.0f} minutes" for v, steps, seconds in runs)
    if "mean_with_start" in state["config"]:
        text += "; then the mean of these weights and those that the last training started from"
    if "share" in state["config"]:
        text += f"; then, after the last validation, its output times {state['config']['share']:g}"
    if "logit_shift" in state["config"]:
        text += f"; then, after the last validation, logit 0 shifted by {state['config']['logit_shift']:g}"
    if "view_shift" in state["config"]:
        shift, first = state["config"]["view_shift"]
        text += f"; then the logits of the views from {first} on shifted by {shift:g}"
    return text


def load_network(path: Path) -> UNet:
    """The network of either kind of file, float32, in inference mode, BatchNorm folded."""
    return exported_network(path) if path.suffix == ".onnx" else fold_batchnorm(trained_network(load_state(path)))


def model_card(model: onnx.ModelProto) -> dict[str, str]:
    """The metadata of an exported model."""
    return {p.key: p.value for p in model.metadata_props}


def exported_network(path: Path) -> UNet:
    """The network of a float32 model, whose weights are all in its convolutions."""
    model = onnx.load(path)
    weights = {i.name: torch.from_numpy(numpy_helper.to_array(i).copy()) for i in model.graph.initializer}
    convolutions = [node for node in model.graph.node if node.op_type == "Conv"]
    views = weights[convolutions[0].input[1]].shape[1] // 3
    net = AgreementUNet(views) if model_card(model).get("added_to") == "view agreement" else UNet(views)
    for index, node in enumerate(convolutions, 1):
        weight = weights[node.input[1]]
        bias = weights[node.input[2]] if len(node.input) > 2 else torch.zeros(len(weight))  # the exporter drops zeros
        conv = nn.Conv2d(weight.shape[1], weight.shape[0], 3, 2 if index in (2, 3, 4) else 1, padding=1)
        conv.weight.data, conv.bias.data = weight, bias
        setattr(net, f"conv{index}", conv if index == 9 else nn.Sequential(conv, nn.ReLU()))
    return net.eval()
