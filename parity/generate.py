"""Goldens for tests/parity.

    python parity/generate.py FOLDER

Seeded cases, one npz each: inputs, the float64 oracle of every stage (`oracle.NAME`), and the
largest and mean error of float32 torch (`torch.NAME`). A stage's inputs are the float32 roundings
of the oracle's outputs of the previous stage, so that a failure names the first stage that differs.
In addition, a seeded, untrained network for each V, and the logits of onnxruntime. The oracle's
network has its BatchNorms, in the exported one they are folded: the logits show that folding
preserves them.
"""

import sys
from pathlib import Path

import numpy as np
import torch

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "python"))

from liveview_ref import onnx_session  # noqa: E402
from liveview_ref.export import export  # noqa: E402
from liveview_ref.parity import stages, surface_goldens  # noqa: E402
from liveview_ref.parity.rigs import SIZE, rig  # noqa: E402
from liveview_ref.reference.geometry.view_selection import view_distances  # noqa: E402
from liveview_ref.reference.layers.cover import cover_planes  # noqa: E402
from liveview_ref.reference.layers.guided.search import search_planes  # noqa: E402
from liveview_ref.reference.layers.histogram import plane_histogram, select_planes  # noqa: E402
from liveview_ref.reference.layers.uniform import uniform_disparities  # noqa: E402
from liveview_ref.reference.unet import UNet, start_from_agreement  # noqa: E402
from liveview_ref.rig_arrays import Arrays, cameras_of  # noqa: E402

NEAR, FAR = 1.0, 8.0

CASES = {  # name: (V, rig, planes or guided layers)
    "random_v4": (4, "random", uniform_disparities(NEAR, FAR, 6)),
    "random_v5": (5, "random", uniform_disparities(NEAR, FAR, 4)),
    "random_v10": (10, "random", uniform_disparities(NEAR, FAR, 3)),
    "rectified_v2": (2, "rectified", uniform_disparities(NEAR, FAR, 8)),
    "one_plane": (4, "random", torch.tensor([0.4], dtype=torch.float64)),
    "infinity": (4, "random", torch.tensor([0.9, 0.5, 0.01, 0.0], dtype=torch.float64)),
    "coincident": (4, "coincident", uniform_disparities(NEAR, FAR, 4)),
    "unseen": (4, "unseen", uniform_disparities(0.6, float("inf"), 5)),
    "guided_v4": (4, "random", 4),
    "guided_v5": (5, "random", 3),
    "guided_v2": (2, "rectified", 2),
    "guided_one": (4, "random", 1),
    "competing_v4": (4, "random", uniform_disparities(NEAR, FAR, 12)),
    "competing_unseen": (4, "unseen", uniform_disparities(0.6, float("inf"), 5)),
    "competing_guided": (4, "random", 3),
    "spaced_v4": (4, "random", uniform_disparities(NEAR, FAR, 12)),
    "spaced_uneven": (4, "random", torch.tensor([0.9, 0.9, 0.89, 0.5, 0.0], dtype=torch.float64)),
    "spaced_one": (4, "random", torch.tensor([0.4], dtype=torch.float64)),
    "spaced_unseen": (4, "unseen", uniform_disparities(0.6, float("inf"), 5)),
}
ALPHA_SCALES = {"competing_v4": 2.0, "competing_unseen": 1.0, "competing_guided": 60.0}  # of competing layers
# Where opacity is per pixel of parallax:
ALPHA_SPACINGS = {"spaced_v4": 2.0, "spaced_uneven": 3.0, "spaced_one": 3.0, "spaced_unseen": 3.0}


def fill(data: Arrays, layers, net: UNet, model: Path) -> None:
    """Add the oracle of each stage, from float32 roundings of the previous one,
    then torch's errors."""
    guided = isinstance(layers, int)
    if guided:
        data["coarse_disparities"] = search_planes(*cameras_of(data), NEAR, FAR).numpy()
        data["cell_maps"] = np.empty(layers)  # its length is the number of layers that the stage makes
    else:
        data["disparities"] = layers.numpy()
    oracle = {}
    for stage in stages.STAGES:
        found = stage(data, torch.float64)
        oracle |= found
        if stage is stages.spacing:
            data |= found
        elif stage not in (stages.homography, stages.composited):
            data |= {name: value.astype(np.float32) for name, value in found.items()}
        if stage is stages.warp:
            oracle |= stages.agreement(data, torch.float64)
            oracle["logits"] = stages.logits(net, data["colour"], torch.float64)
            data["logits"] = oracle["logits"].astype(np.float32)
    for stage in (*stages.STAGES, stages.agreement):
        for name, single in stage(data, torch.float32).items():
            data[f"torch.{name}"] = np.array(stages.errors(single, oracle[name], name)[:2])
    single = stages.logits(net, data["colour"], torch.float32)
    data["torch.logits"] = np.array(stages.errors(single, oracle["logits"], "logits")[:2])
    if not guided:
        width, height = SIZE
        if "alpha_scale" in data:
            best = stages.best_layer(data)
            histogram = torch.from_numpy(np.bincount(best[best >= 0], minlength=len(data["maps"])))
        else:
            histogram = plane_histogram(torch.from_numpy(data["alpha"][:, :height, :width]))
        data["histogram"] = histogram.numpy()
        data["selected"] = np.array(select_planes(histogram, 2))
        data["covering"] = np.array(cover_planes(histogram, 2))
    views, target = cameras_of(data)
    data["distances"] = view_distances(views, target).numpy()
    data["onnxruntime.logits"] = onnx_session.logits(onnx_session.session(model, 1), data["colour"])
    data |= {f"oracle.{name}": value for name, value in oracle.items()}
    data["oracle.end"] = end_to_end(data, net, torch.float64)
    data["reference.end"] = end_to_end(data, net, torch.float32)


def end_to_end(data: Arrays, net: UNet, dtype: torch.dtype) -> np.ndarray:
    """The frame [3, H, W] from photos and layers alone, every stage in `dtype`."""
    given = ("disparities", "cell_maps", "alpha_scale", "alpha_spacing", "logit_shift")
    run = {name: value for name, value in data.items() if "." in name or name in given}
    for stage in (stages.maps, stages.warp, stages.blended, stages.composited):
        if stage is stages.blended:
            run["logits"] = stages.logits(net, run["colour"], dtype)
        run |= stage(run, dtype)
    return run["frame"]


def set_batchnorms(net: UNet) -> None:
    """Set statistics, scales and biases that differ from those of an untrained network as a trained
    network's do."""
    with torch.no_grad():
        for norm in (module for module in net.modules() if isinstance(module, torch.nn.BatchNorm2d)):
            norm.running_mean.normal_(0, 0.1)
            norm.running_var.uniform_(0.25, 4)
            norm.weight.uniform_(0.5, 1.5)
            norm.bias.normal_(0, 0.1)


def main() -> None:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    nets = {}
    for views in {v for v, _, _ in CASES.values()}:
        torch.manual_seed(views)
        net = UNet(views).eval()
        start_from_agreement(net)
        set_batchnorms(net)
        path = folder / f"network_v{views}.onnx"
        export(net, path, {"recommended_layers": "guided:4", "training": "none: seeded", "licence": "MIT"})
        nets[views] = (net, path)
    for index, (name, (views, kind, layers)) in enumerate(CASES.items()):
        data = rig(np.random.default_rng([2021, index]), views, kind)
        if name in ALPHA_SCALES:
            data["alpha_scale"] = np.array([ALPHA_SCALES[name]])
        if name in ALPHA_SPACINGS:
            data["alpha_spacing"] = np.array([ALPHA_SPACINGS[name]])
        fill(data, layers, *nets[views])
        np.savez(folder / f"{name}.npz", **data)
    surface_goldens.write(folder)
    (folder / "cases.txt").write_text("\n".join(CASES) + "\n")


if __name__ == "__main__":
    main()
