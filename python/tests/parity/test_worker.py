"""Every competitor against the float64 reference, and the rows that they add to a report."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from toy_rigs import rig

from liveview_ref.checkpoint import load_network
from liveview_ref.competitors import __main__ as report
from liveview_ref.competitors import pipelines
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


def differs(found: np.ndarray, data: Arrays, weights: Path) -> bool:
    """Whether the errors of a frame exceed the bounds."""
    clear = clear_of_edges(data)
    assert clear.mean() > 0.95
    difference = np.abs(found - reference(data, weights))[clear]
    return not (difference.max() < MOST_ERROR and difference.mean() < MOST_MEAN_ERROR)


def job_of(data: Arrays, models: Path, name: str, batch: int = BATCH) -> pipelines.Job:
    """A competitor's job, with the model for its number of photos."""
    views = len(cameras_of(data)[0])
    return pipelines.Job(data, models / f"v{views}.onnx", models / f"v{views}.pt", name, 2, batch)


@pytest.mark.parametrize("name", pipelines.NAMES)
def test_competitor_is_measured(name, models):
    row = pipelines.measured(job_of(arrays_of("random"), models, name), 2)
    assert row["layers"] == "planes:3" and row["reference"]
    assert ("ONNX Runtime" if name == "onnxruntime + kornia" else "PyTorch") in row["engine"]
    seconds = row["seconds"]
    assert len(seconds["all"]) == 2 and 0 < seconds["min"] <= seconds["median"] <= seconds["max"]
    assert 2**24 < row["peak_memory_bytes"] < 2**34


@pytest.mark.parametrize("name", pipelines.NAMES)
@pytest.mark.parametrize("case", CASES)
def test_competitor_renders_like_the_reference(case, name, models):
    data = arrays_of(case)
    job = job_of(data, models, name)
    competitor = pipelines.start(job)
    parts = ["total"] if name == "reference" else ["warp", "network", "composite"]
    for _ in range(2):  # the second render does not depend on the first
        frame, seconds = competitor.render()
        assert frame.shape == (38, 53, 3) and frame.dtype == np.float32
        assert not differs(frame, data, job.weights)
        assert list(seconds) == parts and min(seconds.values()) > 0


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


def test_network_without_a_checkpoint_is_the_model(models):
    data = arrays_of("pair")
    job = replace(job_of(data, models, "torch", batch=1), weights=None)
    assert not differs(pipelines.start(job).render()[0], data, models / "v2.pt")


def test_rows_are_added_to_a_report(models, tmp_path, monkeypatch):
    data = arrays_of("random")
    monkeypatch.setattr(report, "rig_of", lambda found: data)
    monkeypatch.setattr(report, "os", SimpleNamespace(environ={}))
    own = {"layers": "planes:3", "engine": "ort", "seconds": {"all": [0.5, 0.6]}}
    path, text = tmp_path / "sweep.json", tmp_path / "sweep.md"
    path.write_text(json.dumps({"threads": 2, "batch": BATCH, "rows": [own]}))
    text.write_text("# Report\n")
    for _ in range(2):  # the second run replaces the rows of the first
        report.main([str(path), "--model", str(models / "v4.onnx")])
        first, *added = json.loads(path.read_text())["rows"]
        assert first == own and [len(row["seconds"]["all"]) for row in added] == [2] * len(pipelines.NAMES)
        assert len({row["engine"] for row in added}) == len(pipelines.NAMES)
        lines = text.read_text().splitlines()
        assert lines[0] == "# Report" and sum(line.startswith("| planes:3 |") for line in lines) == len(added)
