"""The network without a scene."""

import numpy as np
import pytest
from hostile_cases import f32

from liveview_ref.onnx_session import session
from liveview_ref.paths import MODELS

MODEL = MODELS / "liveview_v4.onnx"


@pytest.fixture(scope="module")
def network(liveview):
    return liveview.Network(MODEL, threads=1)


def test_logits_are_onnxruntime_s_bit_for_bit(network):
    hwv = np.random.default_rng(3).random((2, 12, 16, 24), np.float32)
    expected = session(MODEL, 1).run(["logits"], {"hwv": hwv})[0]
    assert network.views == 4 and expected.shape == (2, 4, 16, 24)
    assert network(hwv).tobytes() == network(hwv[:, :, ::-1][:, :, ::-1]).tobytes() == expected.tobytes()


@pytest.mark.parametrize(
    "hwv, kind",
    [
        (np.zeros((1, 12, 8, 8)), TypeError),
        ("photos", TypeError),
        (f32(1, 9, 8, 8), ValueError),
        (f32(12, 8, 8), ValueError),
        (f32(1, 12, 8, 12), ValueError),
        (f32(0, 12, 8, 8), ValueError),
        (np.broadcast_to(np.float32(0), (1, 12, 8, 16392)), ValueError),
    ],
)
def test_hostile_photos_are_named(network, hwv, kind):
    with pytest.raises(kind, match="hwv"):
        network(hwv)


def test_hostile_models_are_the_library_s_errors(liveview, tmp_path):
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"no model")
    for path in (tmp_path / "missing.onnx", broken):
        with pytest.raises(liveview.Error, match=path.name):
            liveview.Network(path)
    for threads, kind in ((0, liveview.Error), (-1, TypeError), (1000, liveview.Error)):
        with pytest.raises(kind, match="threads"):
            liveview.Network(MODEL, threads=threads)
