"""Goldens for tests/parity.rs: python parity/generate.py FOLDER

Seeded cases, each one npz: inputs, the float64 oracle of every stage, and the largest and mean error of float32 torch
(`torch.NAME`). A stage's inputs are the float32 roundings of the oracle's outputs of the stage before, so that a
failure names the first stage that departs. Beside them a seeded,
untrained network for each V, and onnxruntime's logits.
"""

import sys
from pathlib import Path

import numpy as np
import torch

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "python"))

from liveview_ref import guide, parity, select, stages  # noqa: E402
from liveview_ref.export import export  # noqa: E402
from liveview_ref.layers import uniform_planes  # noqa: E402
from liveview_ref.render import view_distances  # noqa: E402
from liveview_ref.unet import UNet, start_from_agreement  # noqa: E402

SIZE = (53, 38)  # width, height of the target: not multiples of 8
SOURCE = (61, 45)
NEAR, FAR = 1.0, 8.0


def photo(rng: np.random.Generator) -> np.ndarray:
    """Smooth waves and noise [h, w, 3] float32 in [0, 1]."""
    width, height = SOURCE
    y, x = np.mgrid[:height, :width]
    waves = [np.sin(rng.uniform(0, 0.5) * x + rng.uniform(0, 0.5) * y + rng.uniform(0, 6)) for _ in range(9)]
    image = np.stack([sum(waves[c::3]) / 6 + 0.5 for c in range(3)], -1)
    return np.clip(image + rng.normal(0, 0.05, image.shape), 0, 1).astype(np.float32)


def turned(angles: np.ndarray) -> np.ndarray:
    """Rotation by an axis times an angle, radians."""
    x, y, z = angles
    return torch.linalg.matrix_exp(torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=torch.float64)).numpy()


def rig(rng: np.random.Generator, views: int, kind: str) -> dict[str, np.ndarray]:
    """Photos and cameras, nearest view first, of a case."""
    data, placed = {}, []
    for _ in range(views):
        rotation, centre = turned(rng.normal(0, 0.06, 3)), rng.normal(0, 0.25, 3)
        k = np.array([[50 * rng.uniform(0.9, 1.1), 0, 30.5], [0, 50, 22.5], [0, 0, 1.0]])
        if kind == "rectified":
            rotation, centre, k = np.eye(3), np.array([rng.normal(0, 0.3), 0, 0]), np.diag([50.0, 50, 1]) + 0
            k[:2, 2] = 30.5, 22.5
        placed.append((rotation, centre, k))
    target = (
        turned(rng.normal(0, 0.03, 3)),
        rng.normal(0, 0.05, 3),
        np.array([[45.0, 0, 26], [0, 45, 19.5], [0, 0, 1]]),
    )
    if kind == "rectified":
        target = (np.eye(3), np.zeros(3), target[2])
    if kind == "coincident":
        target = (target[0], placed[0][1], target[2])
    if kind == "unseen":  # one view looks away, one stands far aside, and planes cross the cameras (w changes sign)
        placed[0] = (turned(np.array([0, np.pi, 0])), *placed[0][1:])
        placed[1] = (placed[1][0], np.array([40.0, 0, 0]), placed[1][2])
        placed[2] = (turned(np.array([0, 1.3, 0])), np.array([0, 0, 1.5]), placed[2][2])
    placed.sort(key=lambda p: float(np.linalg.norm(p[1] - target[1])))
    for name, (rotation, centre, k) in [*((f"view{i}", p) for i, p in enumerate(placed)), ("target", target)]:
        data |= {f"{name}.rotation": rotation, f"{name}.translation": -rotation @ centre, f"{name}.k": k}
    data |= {f"view{i}.image": photo(rng) for i in range(views)}
    return data | {"target.size": np.array(SIZE)}


CASES = {  # name: (V, rig, planes or guided layers)
    "random_v4": (4, "random", uniform_planes(NEAR, FAR, 6)),
    "random_v5": (5, "random", uniform_planes(NEAR, FAR, 4)),
    "random_v10": (10, "random", uniform_planes(NEAR, FAR, 3)),
    "rectified_v2": (2, "rectified", uniform_planes(NEAR, FAR, 8)),
    "one_plane": (4, "random", torch.tensor([0.4], dtype=torch.float64)),
    "infinity": (4, "random", torch.tensor([0.9, 0.5, 0.01, 0.0], dtype=torch.float64)),
    "coincident": (4, "coincident", uniform_planes(NEAR, FAR, 4)),
    "unseen": (4, "unseen", uniform_planes(0.6, float("inf"), 5)),
    "guided_v4": (4, "random", 4),
    "guided_v5": (5, "random", 3),
    "guided_v2": (2, "rectified", 2),
    "guided_one": (4, "random", 1),
}


def fill(data: stages.Arrays, layers, net: UNet, model: Path) -> None:
    """Oracle of each stage, from float32 roundings of the one before; then torch's errors."""
    guided = isinstance(layers, int)
    if guided:
        data["coarse.disparities"] = guide.search_planes(*stages.cameras_of(data), NEAR, FAR).numpy()
        data["cell_maps"] = np.empty(layers)  # as many as the stage is to make
    else:
        data["disparities"] = layers.numpy()
    oracle = {}
    for stage in stages.STAGES:
        found = stage(data, torch.float64)
        oracle |= found
        if stage not in (stages.homography, stages.composited):
            data |= {name: value.astype(np.float32) for name, value in found.items()}
        if stage is stages.warp:
            oracle["logits"] = parity.logits(net, data["colour"], torch.float64)
            data["logits"] = oracle["logits"].astype(np.float32)
    for stage in stages.STAGES:
        for name, single in stage(data, torch.float32).items():
            data[f"torch.{name}"] = np.array(stages.errors(single, oracle[name], name)[:2])
    single = parity.logits(net, data["colour"], torch.float32)
    data["torch.logits"] = np.array(stages.errors(single, oracle["logits"], "logits")[:2])
    if guided:
        data["kmeans"] = np.array(select.kmeans_planes(data["fine"], 3))
    else:
        width, height = SIZE
        histogram = select.plane_histogram(torch.from_numpy(data["alpha"][:, :height, :width]))
        data["histogram"] = histogram.numpy()
        data["selected"] = np.array(select.select_planes(histogram, 2))
    views, target = stages.cameras_of(data)
    data["distances"] = view_distances(views, target).numpy()
    data["onnxruntime.logits"] = parity.onnx_logits(model, data["colour"], 1, len(data["colour"]))
    data |= {f"oracle.{name}": value for name, value in oracle.items()}
    data["oracle.end"] = end_to_end(data, net, torch.float64)
    data["reference.end"] = end_to_end(data, net, torch.float32)


def end_to_end(data: stages.Arrays, net: UNet, dtype: torch.dtype) -> np.ndarray:
    """The frame [3, H, W] from photos and layers alone, every stage in `dtype`."""
    run = {name: value for name, value in data.items() if "." in name or name in ("disparities", "cell_maps")}
    for stage in (stages.maps, stages.warp, stages.blended, stages.composited):
        if stage is stages.blended:
            run["logits"] = parity.logits(net, run["colour"], dtype)
        run |= stage(run, dtype)
    return run["frame"]


def main() -> None:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    nets = {}
    for views in {v for v, _, _ in CASES.values()}:
        torch.manual_seed(views)
        net = UNet(views).eval()
        start_from_agreement(net)
        path = folder / f"network_v{views}.onnx"
        export(net, path, {"recommended_layers": "guided 4", "training": "none: seeded", "licence": "MIT"})
        nets[views] = (parity.load_network(path), path)
    for index, (name, (views, kind, layers)) in enumerate(CASES.items()):
        data = rig(np.random.default_rng([2021, index]), views, kind)
        fill(data, layers, *nets[views])
        np.savez(folder / f"{name}.npz", **data)
    (folder / "cases.txt").write_text("\n".join(CASES) + "\n")


if __name__ == "__main__":
    main()
