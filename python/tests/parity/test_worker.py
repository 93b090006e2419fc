"""Every competitor, through the protocol of its worker, against the float64 reference."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from toy_rigs import rig

from liveview_ref.checkpoint import load_network
from liveview_ref.competitors import pipelines, worker
from liveview_ref.export import export
from liveview_ref.reference.layers import source_coordinates
from liveview_ref.reference.liveview import PlaneSweep, UNet, render
from liveview_ref.rig_arrays import Arrays, cameras_of, images_of
from liveview_ref.weights import start_from_agreement

MOST_ERROR = 1e-4  # coordinates err by 1e-5 pixels, and these noisy photos change by up to 0.5 per pixel
MOST_MEAN_ERROR = 1e-6
EDGE = 1e-3  # pixels from a photo's edge within which rounding decides on coverage
BATCH = 2  # of 3 planes: the sums continue over batches, and the last batch is a smaller one

CASES = {  # name: (V, rig, disparities)
    "random": (4, "random", [0.9, 0.45, 0.15]),
    "infinity": (4, "random", [1.0, 0.3, 0.0]),
    "pair": (2, "rectified", [0.9, 0.45, 0.15]),
    "coincident": (4, "coincident", [0.9, 0.45, 0.15]),
    "behind": (4, "unseen", [1.6, 0.6, 0.05]),
}


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Untrained networks of 2 and 4 views, as checkpoints and exported."""
    folder = tmp_path_factory.mktemp("models")
    for views in (2, 4):
        torch.manual_seed(views)
        net = UNet(views)
        start_from_agreement(net)
        net(torch.rand(4, 3 * views, 32, 32))  # changes the statistics of BatchNorm
        net.eval()
        torch.save({"average": net.state_dict(), "views": views}, folder / f"v{views}.pt")
        export(net, folder / f"v{views}.onnx", {"licence": "none"})
    return folder


def arrays_of(name: str) -> Arrays:
    """A job with a target of 53 x 38 pixels; one photo is smaller than the others."""
    views, kind, disparities = CASES[name]
    data = rig(np.random.default_rng([7, views]), views, kind)
    data["view1.image"] = np.ascontiguousarray(data["view1.image"][:-5, :-3])
    return data | {"disparities": np.array(disparities)}


def reference(data: Arrays, weights: Path) -> np.ndarray:
    """The frame in float64, [h, w, 3]."""
    cameras, target = cameras_of(data)
    planes = torch.from_numpy(data["disparities"])
    network = load_network(weights).double()
    with torch.no_grad():
        return render(network, images_of(data, torch.float64), cameras, target, planes)[0].rgb.permute(1, 2, 0).numpy()


def clear_of_edges(data: Arrays) -> np.ndarray:
    """Pixels [h, w] that no plane maps to within EDGE of a photo's edge."""
    cameras, target = cameras_of(data)
    maps = torch.from_numpy(data["disparities"])[:, None, None].expand(-1, target.height, target.width)
    clear = torch.ones(target.height, target.width, dtype=torch.bool)
    for camera in cameras:
        coordinates, w = source_coordinates(PlaneSweep.of(camera, target), maps)
        for at, side in zip(coordinates.unbind(-1), (camera.width, camera.height), strict=True):
            near = torch.minimum((at + 0.5).abs(), (at - side - 0.5).abs()) < EDGE
            clear &= ~near.any(0)
        clear &= ~(w.abs() < EDGE).any(0)
    return clear.numpy()


def drive(requests: list[dict | str]) -> tuple[int, list[dict], str]:
    """(exit code, replies, notes) of a worker that reads these lines."""
    lines = "".join((r if isinstance(r, str) else json.dumps(r)) + "\n" for r in requests)
    command = [sys.executable, "-m", "liveview_ref.competitors.worker"]
    where = {"cwd": Path(__file__).parents[2], "env": os.environ | {"PYTHONPATH": "."}}
    done = subprocess.run(command, input=lines, capture_output=True, text=True, timeout=300, **where)
    return done.returncode, [json.loads(line) for line in done.stdout.splitlines()], done.stderr


def differs(found: np.ndarray, data: Arrays, weights: Path) -> bool:
    """Whether the errors of a frame exceed the bounds."""
    clear = clear_of_edges(data)
    assert clear.mean() > 0.95
    difference = np.abs(found - reference(data, weights))[clear]
    return not (difference.max() < MOST_ERROR and difference.mean() < MOST_MEAN_ERROR)


def job_of(data: Arrays, models: Path, views: int, name: str, folder: Path) -> dict:
    """The first line to a worker."""
    np.savez(folder / "job.npz", **data)
    model = {"model": str(models / f"v{views}.onnx"), "weights": str(models / f"v{views}.pt")}
    return {"job": str(folder / "job.npz"), **model, "engine": name, "threads": 2, "batch": BATCH}


@pytest.mark.parametrize("name", pipelines.NAMES)
def test_competitor_follows_the_protocol(name, models, tmp_path):
    data = arrays_of("random")
    request = job_of(data, models, 4, name, tmp_path)
    runs = [{"run": True}, {"run": True, "frame": str(tmp_path / "frame.npy")}, {"quit": True}]
    code, (ready, *timed), notes = drive([request, *runs])
    assert code == 0 and ready["ready"] and len(timed) == 2, notes
    assert ("ONNX Runtime" if name == "onnxruntime + kornia" else "PyTorch") in ready["engine"]
    for reply in timed:
        parts = ["total"] if name == "reference" else ["warp", "network", "composite"]
        assert list(reply["seconds"]) == parts and min(reply["seconds"].values()) > 0
        assert 2**24 < reply["peak_memory_bytes"] < 2**34
    frame = np.load(tmp_path / "frame.npy")
    assert frame.shape == (38, 53, 3) and frame.dtype == np.float32
    assert not differs(frame, data, models / "v4.pt")


@pytest.mark.parametrize("name", pipelines.NAMES)
@pytest.mark.parametrize("case", [case for case in CASES if case != "random"])
def test_competitor_renders_like_the_reference(case, name, models, tmp_path):
    data, views = arrays_of(case), CASES[case][0]
    competitor = pipelines.start(pipelines.Job.of(job_of(data, models, views, name, tmp_path)))
    for _ in range(2):  # the second render does not depend on the first
        assert not differs(competitor.render()[0], data, models / f"v{views}.pt")


@pytest.mark.parametrize("change", ["half a pixel", "planes reversed", "a view's distance", "no background"])
def test_small_mistakes_exceed_the_bounds(change, models):
    data, weights = arrays_of("random"), models / "v4.pt"
    wrong = dict(data)
    if change == "half a pixel":
        wrong["target.k"] = data["target.k"] + [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    elif change == "planes reversed":
        wrong["disparities"] = data["disparities"][::-1].copy()
    elif change == "a view's distance":
        wrong["view3.translation"] = data["view3.translation"] * 1.01
    else:
        wrong["disparities"] = data["disparities"][:-1]
    assert differs(reference(wrong, weights), data, weights)
    assert not differs(reference(data, weights).astype(np.float32), data, weights)


def test_worker_without_weights_takes_the_model(models, tmp_path):
    data = arrays_of("pair")
    frame = tmp_path / "frame.npy"
    request = job_of(data, models, 2, "torch", tmp_path) | {"weights": None, "batch": 1, "threads": 1}
    code, _, notes = drive([request, {"run": True, "frame": str(frame)}])  # end of input: quits
    assert code == 0, notes
    assert not differs(np.load(frame), data, models / "v2.pt")


def test_failures_are_reported(models, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "environ", os.environ.copy())
    request = job_of(arrays_of("pair"), models, 2, "torch", tmp_path)
    for changes, message in [
        ({"engine": "jax"}, "no competitor 'jax'"),
        ({"job": str(tmp_path / "none.npz")}, "none.npz"),
        ({"batch": 0}, "at least 1"),
    ]:
        with pytest.raises((ValueError, OSError), match=message):
            worker.serve(io.StringIO(json.dumps(request | changes) + "\n"), io.StringIO())
    code, (ready, error), _ = drive([request, {"walk": True}])
    assert code == 2 and ready["ready"] and "expected run or quit" in error["error"]
    code, (error,), _ = drive(["not json"])
    assert code == 2 and "JSONDecodeError" in error["error"]
    assert drive([]) == (0, [], "")
