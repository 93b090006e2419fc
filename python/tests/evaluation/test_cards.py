"""The shipped models: weights, metadata, and records."""

import onnx
import pytest

from liveview_ref.checkpoint import load_network, load_state, model_card, records, trained_network
from liveview_ref.export import check
from liveview_ref.paths import MODELS


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.onnx")), ids=lambda path: path.stem)
def test_metadata_of_shipped_models(path):
    card = model_card(onnx.load(path))
    assert path.stem.startswith(f"liveview_v{card['views']}")
    for_planes, for_surface = "_planes" in path.stem, "_surface" in path.stem
    trained_on_planes = for_planes or card["views"] != "4"
    competing = for_surface or (trained_on_planes and "_planes_paper" not in path.stem)
    assert card["recommended_layers"].startswith("planes:") == for_planes
    assert card.get("added_to") == ("view agreement" if for_surface else None)
    assert card.get("alpha", "independent") == ("competing" if competing else "independent")
    kinds = "planes, select, list" if for_planes else "surface" if for_surface else None
    assert card.get("layer_kinds") == kinds
    assert card["licence"] and card["training"] and ("int8" in path.stem) == (card.get("precision") == "int8")


def test_model_equals_its_checkpoint():
    path = MODELS / "liveview_v4.pt"
    assert check(load_network(path), path.with_suffix(".onnx")) < 3e-6  # 7e-7 measured


def test_every_float32_model_has_a_record_of_its_training():
    models = {path.stem for path in MODELS.glob("*.onnx") if not path.stem.endswith("_int8")}
    assert set(records(MODELS)) == models


def test_state_of_a_model_gives_its_network_back():
    path = MODELS / "liveview_v5.onnx"
    state = load_state(path)
    assert state["views"] == 5 and state["step"] == 700
    assert check(trained_network(state), path) < 3e-6
