"""Quantise an exported model to int8.

    python -m liveview_ref.quantize MODEL.onnx OUT.onnx CONFIG --data DATA

Static, by onnxruntime: activations uint8, weights int8 per channel. Calibrated on examples of
CONFIG's training (crops of its real scenes and procedural scenes, on guided layers and planes).
Inputs, outputs and metadata stay, with `precision` and `quantised` added. Writes OUT.onnx, and
into int8.json and int8.md beside it the loss by quantising each layer alone, and all of them.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
import onnx
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

from .checkpoint import model_card
from .data.examples import RealScene, make_example, procedural
from .data.procedural.textures import Textures
from .evaluation.quantize_loss import Photo, loss, photos
from .training.train import read_config

# Stays float32: quantising it loses more than quantising all other layers together (figures in the
# card).
FLOAT_LAYERS = ("conv1",)
EXAMPLES = 48
CROP = (96, 96)
RECORD = "int8.json"


class Calibration(CalibrationDataReader):
    """Gives HWVs [L, 3V, h, w], one after the other."""

    def __init__(self, hwvs: list[np.ndarray]):
        self.left = iter(hwvs)

    def get_next(self) -> dict[str, np.ndarray] | None:
        hwv = next(self.left, None)
        return None if hwv is None else {"hwv": hwv}


def calibration_hwvs(config: dict, data: Path | None, count: int) -> list[np.ndarray]:
    """HWVs as in training, from another seed; procedural scenes alone without data."""
    rng = np.random.default_rng([config["seed"], 8])
    real = [RealScene(data, spec, config["views"]) for spec in config["real"]] if data else []
    real = [scene for scene in real if scene.weight]
    textures = Textures(data / config["textures"] if data else None)
    found = []
    for index in range(count):
        if index % 2 and real:
            source = real[index // 2 % len(real)].draw(rng, config["views"], CROP)
        else:
            source = procedural(rng, config["views"], CROP, textures)
        found.append(make_example(rng, source, config).hwv.float().numpy())
    return found


def convolutions(model: onnx.ModelProto) -> dict[str, str]:
    """The paper's name (conv1, conv2, ...) -> the name of the node."""
    nodes = [node.name for node in model.graph.node if node.op_type == "Conv"]
    return {f"conv{index}": name for index, name in enumerate(nodes, 1)}


def quantise(path: Path, out: Path, hwvs: list[np.ndarray], layers: set[str], reduce_range: bool = True) -> None:
    """Quantise these layers. `reduce_range`: weights of 7 bits, for CPUs without VNNI, whose sums
    of two products saturate at 16 bits. If every layer but FLOAT_LAYERS is quantised, so are the
    operations between them."""
    model = onnx.load(path)
    names = convolutions(model)
    whole = layers == set(names) - set(FLOAT_LAYERS)
    quantize_static(
        model,
        out,
        Calibration(hwvs),
        quant_format=QuantFormat.QDQ,
        activation_type=QuantType.QUInt8,
        weight_type=QuantType.QInt8,
        per_channel=True,
        reduce_range=reduce_range,
        op_types_to_quantize=["Conv", "Relu", "Resize", "Concat"] if whole else ["Conv"],
        nodes_to_exclude=[names[layer] for layer in names if layer not in layers],
    )
    quantised = onnx.load(out)
    free_logits(quantised.graph)
    summary = f"{len(layers)} of {len(names)} layers, calibrated on {len(hwvs)} training examples"
    onnx.helper.set_model_props(quantised, model_card(model) | {"precision": "int8", "quantised": summary})
    onnx.checker.check_model(quantised, full_check=True)
    onnx.save(quantised, out)


def free_logits(graph: onnx.GraphProto) -> None:
    """Leave the logits in float32: 256 steps are too few for the tails of a sigmoid, and no
    convolution follows."""
    made_by = {name: node for node in graph.node for name in node.output}
    dequantise = made_by["logits"]
    if dequantise.op_type != "DequantizeLinear":
        return
    quantise = made_by[dequantise.input[0]]
    made_by[quantise.input[0]].output[0] = "logits"
    graph.node.remove(dequantise)
    graph.node.remove(quantise)
    used = {name for node in graph.node for name in node.input}
    for unused in [i for i in graph.initializer if i.name not in used]:
        graph.initializer.remove(unused)


def losses(path: Path, hwvs: list[np.ndarray], held_out: list[Photo]) -> dict[str, list[float]]:
    """By what is quantised: the error of the logits, and the change of PSNR in dB of each kind of
    layers."""
    names = convolutions(onnx.load(path))
    chosen = set(names) - set(FLOAT_LAYERS)
    trials = {f"{layer} alone": ({layer}, True) for layer in names}
    trials |= {"all": (set(names), True), f"all but {', '.join(FLOAT_LAYERS)}: the model": (chosen, True)}
    trials["the same, weights of 8 bits"] = (chosen, False)
    exact, found = loss(path, held_out), {}
    with tempfile.TemporaryDirectory() as folder:
        for trial, (layers, reduce_range) in trials.items():
            made = Path(folder) / "trial.onnx"
            quantise(path, made, hwvs, layers, reduce_range)
            measured = loss(made, held_out, exact)
            found[trial] = [round(measured.logits, 6), *(round(x, 4) for x in measured.psnr.values())]
            print(trial, found[trial], flush=True)
    return found


def card(record: dict[str, dict]) -> str:
    """The Markdown card of all int8 models."""
    lines = [
        "# The int8 models\n",
        "Each is the model of its name with all layers but conv1 in int8: activations uint8, weights int8 per",
        "channel, of 7 bits (CPUs without VNNI add pairs of products in 16 bits, which 8-bit weights can saturate).",
        f"Input and output are float32. Calibrated on {EXAMPLES} examples of the model's training by",
        "`make models STEP=int8`. Training and licence as of the original.\n",
        "Loss by quantising: root mean square error of the logits relative to their own root mean square, in %, and",
        "change of PSNR in dB on the layers named, over held-out renders of `dev/` (their number: last row).\n",
        "| quantised | " + " | ".join(f"{name}: {', '.join(each['kinds'])}" for name, each in record.items()) + " |",
        "|---" * (1 + len(record)) + "|",
    ]
    for trial in next(iter(record.values()))["losses"]:
        found = [each["losses"][trial] for each in record.values()]
        cells = [", ".join([f"{100 * logits:.2f}", *(f"{x:+.3f}" for x in psnr)]) for logits, *psnr in found]
        lines.append(f"| {trial} | " + " | ".join(cells) + " |")
    lines.append("| renders | " + " | ".join(str(each["renders"]) for each in record.values()) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("config", type=Path, help="the training config of the model")
    parser.add_argument("--data", type=Path, required=True, help="folder with train/, dev/ and textures/")
    args = parser.parse_args()
    config = read_config(args.config)
    model = onnx.load(args.model)
    hwvs = calibration_hwvs(config, args.data, EXAMPLES)
    quantise(args.model, args.out, hwvs, set(convolutions(model)) - set(FLOAT_LAYERS))
    held_out = photos(config["validation"], args.data, config["views"], model_card(model))
    path = args.out.parent / RECORD
    record = json.loads(path.read_text()) if path.exists() else {}
    kinds = list(loss(args.model, held_out).psnr)
    found = {"kinds": kinds, "renders": len(held_out), "losses": losses(args.model, hwvs, held_out)}
    record = dict(sorted((record | {args.model.stem.removeprefix("liveview_"): found}).items()))
    path.write_text(json.dumps(record, indent=1) + "\n")
    path.with_suffix(".md").write_text(card(record))


if __name__ == "__main__":
    main()
