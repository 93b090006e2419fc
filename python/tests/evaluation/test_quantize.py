"""Quantised models keep the interface of the float32 ones, and their logits are close to theirs."""

from pathlib import Path

import numpy as np
import onnx
import pytest

from liveview_ref.checkpoint import model_card
from liveview_ref.onnx_session import logits, session
from liveview_ref.quantize import FLOAT_LAYERS, calibration_hwvs, convolutions, quantise
from liveview_ref.training.train import read_config

ROOT = Path(__file__).parents[3]
MODELS = ROOT / "models"


def off(path: Path, original: Path, hwvs: list[np.ndarray]) -> float:
    """Root mean square error of the logits relative to their root mean square."""
    networks = session(path), session(original)
    pairs = [[logits(network, hwv) for network in networks] for hwv in hwvs]
    return float(np.sqrt(sum(((a - b) ** 2).sum() for a, b in pairs) / sum((b**2).sum() for _, b in pairs)))


@pytest.fixture(scope="module")
def hwvs():
    return calibration_hwvs(read_config(ROOT / "python/configs/v4.json"), None, 4)


def test_quantised_model_keeps_its_interface_and_its_logits(tmp_path, hwvs):
    original, made = MODELS / "liveview_v4.onnx", tmp_path / "int8.onnx"
    model = onnx.load(original)
    quantise(original, made, hwvs, set(convolutions(model)) - set(FLOAT_LAYERS))
    found = onnx.load(made)
    for a, b in [(found.graph.input[0], model.graph.input[0]), (found.graph.output[0], model.graph.output[0])]:
        assert (a.name, a.type) == (b.name, b.type)
    card = model_card(found)
    assert card.pop("precision") == "int8" and card.pop("quantised").startswith("8 of 9 layers")
    assert card == model_card(model)
    assert sum(node.op_type == "QuantizeLinear" for node in found.graph.node) > 8
    assert off(made, original, hwvs) < 0.03  # on its calibration examples; four are too few for others


@pytest.mark.parametrize("path", sorted(MODELS.glob("*_int8.onnx")), ids=lambda path: path.stem)
def test_shipped_int8_model_matches_its_float32_model(path):
    original = path.with_name(path.name.replace("_int8", ""))
    config = read_config(ROOT / f"python/configs/{original.stem.removeprefix('liveview_')}.json")
    assert off(path, original, calibration_hwvs(config, None, 4)) < 0.05
