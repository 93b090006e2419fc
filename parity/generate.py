"""Goldens for tests/parity.

    python parity/generate.py FOLDER

Seeded cases, one npz each: inputs, the float64 oracle of every stage (`oracle.NAME`), and the
largest and mean error of float32 torch (`torch.NAME`), of liveview_ref/parity/stage_cases.py and
surface_goldens.py. In addition, a seeded, untrained network for each V, and the logits of
onnxruntime. The oracle's network has its BatchNorms, in the exported one they are folded: the
logits show that folding preserves them.
"""

import sys
from pathlib import Path

import numpy as np
import torch

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "python"))

from liveview_ref import onnx_session  # noqa: E402
from liveview_ref.export import export  # noqa: E402
from liveview_ref.parity import stage_cases, stages, surface_goldens  # noqa: E402
from liveview_ref.reference.unet import UNet  # noqa: E402
from liveview_ref.rig_arrays import Arrays  # noqa: E402


def golden(name: str, net: UNet, model: Path) -> Arrays:
    """All arrays of a case."""
    data, oracle = stage_cases.case(name)
    for stage in (*stages.STAGES, stages.agreement):
        for output, single in stage(data, torch.float32).items():
            data[f"torch.{output}"] = np.array(stages.errors(single, oracle[output], output)[:2])
    single = stages.logits(net, data["colour"], torch.float32)
    data["torch.logits"] = np.array(stages.errors(single, oracle["logits"], "logits")[:2])
    data["onnxruntime.logits"] = onnx_session.logits(onnx_session.session(model, 1), data["colour"])
    data |= {f"oracle.{output}": value for output, value in oracle.items()}
    data["oracle.end"] = end_to_end(data, net, torch.float64)
    data["reference.end"] = end_to_end(data, net, torch.float32)
    return data


def end_to_end(data: Arrays, net: UNet, dtype: torch.dtype) -> np.ndarray:
    """The frame [3, H, W] from photos and layers alone, every stage in `dtype`."""
    given = ("disparities", "cell_maps", "alpha_scale", "alpha_spacing", "logit_shift")
    run = {name: value for name, value in data.items() if "." in name or name in given}
    for stage in (stages.maps, stages.warp, stages.blended, stages.composited):
        if stage is stages.blended:
            run["logits"] = stages.logits(net, run["colour"], dtype)
        run |= stage(run, dtype)
    return run["frame"]


def main() -> None:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    models = {}
    for views in {v for v, _, _ in stage_cases.CASES.values()}:
        models[views] = folder / f"network_v{views}.onnx"
        about = {"recommended_layers": "guided:4", "training": "none: seeded", "licence": "MIT"}
        export(stage_cases.network(views), models[views], about)
    for name, (views, _, _) in stage_cases.CASES.items():
        np.savez(folder / f"{name}.npz", **golden(name, stage_cases.network(views), models[views]))
    surface_goldens.write(folder)
    (folder / "cases.txt").write_text("\n".join(stage_cases.CASES) + "\n")


if __name__ == "__main__":
    main()
