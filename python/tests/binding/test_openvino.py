"""The logits of OpenVINO within the bounds of parity/tolerances.json, where it is installed (`make
setup WITH=openvino`). In a process of its own: a process loads one ONNX Runtime."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from compared_cases import case_of, check

from liveview_ref.export import export
from liveview_ref.parity import stage_cases
from liveview_ref.paths import ROOT

LIBRARY = next(ROOT.glob(".venv-openvino/lib/python*/site-packages/onnxruntime/capi"), None)
RUN = """
import sys
import liveview, numpy
library, model, *files = sys.argv[1:]
for file in files:
    numpy.save(file, liveview._stages.logits(model, numpy.load(file), library))
"""


@pytest.mark.skipif(LIBRARY is None, reason="needs `make setup WITH=openvino`")
@pytest.mark.parametrize("views", [4, 5, 2])
def test_openvino_logits(liveview, tmp_path, views):
    """Each session runs inputs of different sizes."""
    names = [name for name in (f"guided_v{views}", f"random_v{views}") if name in stage_cases.CASES]
    model, files = tmp_path / "model.onnx", [tmp_path / f"{name}.npy" for name in names]
    export(
        stage_cases.network(views).float(),
        model,
        {"recommended_layers": "guided:4", "training": "none", "licence": "MIT"},
    )
    for name, file in zip(names, files, strict=True):
        np.save(file, case_of(name).data["colour"])
    run = [sys.executable, "-c", RUN, LIBRARY, model, *files]
    subprocess.run(run, check=True, cwd=Path(liveview.__file__).parents[1])
    for name, file in zip(names, files, strict=True):
        exact = case_of(name).oracle["logits"]
        check("logits openvino", np.load(file), exact, exact, scaled=True)
