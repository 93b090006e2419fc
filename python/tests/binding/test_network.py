"""The network without a scene: the logits of ONNX Runtime bit for bit, those of OpenVINO within the
bounds of parity/tolerances.json where it is installed (`make setup WITH=openvino`)."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hostile_cases import f32

from liveview_ref.export import export
from liveview_ref.onnx_session import session
from liveview_ref.paths import MODELS, ROOT

MODEL = MODELS / "liveview_v4.onnx"
OPENVINO = next(ROOT.glob(".venv-openvino/lib/python*/site-packages/onnxruntime/capi"), None)
# In a process of its own: a process loads one ONNX Runtime.
RUN_OPENVINO = """
import sys
import liveview, numpy
library, model, *files = sys.argv[1:]
for file in files:
    numpy.save(file, liveview._stages.logits(model, numpy.load(file), library))
"""


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


@pytest.mark.skipif(OPENVINO is None, reason="needs `make setup WITH=openvino`")
@pytest.mark.parametrize("views", [4, 5, 2])
def test_openvino_logits(liveview, tmp_path, views):
    """Each session runs inputs of different sizes."""
    import compared_cases as cases

    from liveview_ref.parity import stages

    names = [name for name in (f"guided_v{views}", f"random_v{views}") if name in cases.CASES]
    model, files = tmp_path / "model.onnx", [tmp_path / f"{name}.npy" for name in names]
    about = {"recommended_layers": "guided:4", "training": "none", "licence": "MIT"}
    export(cases.network(views).float(), model, about)
    inputs = [cases.rendered(name, model)[1] for name in names]
    for data, file in zip(inputs, files, strict=True):
        np.save(file, data["colour"])
    run = [sys.executable, "-c", RUN_OPENVINO, OPENVINO, model, *files]
    subprocess.run(run, check=True, cwd=Path(liveview.__file__).parents[1])
    for data, file in zip(inputs, files, strict=True):
        found = stages.logits(data | {"logits": np.load(file)}, cases.network(views), "logits openvino")
        assert not found.departs, found.row()
