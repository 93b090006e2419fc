"""What is inside the stages of the package, from photos to frame: the library and the reference in
one process, on the same arrays."""

from pathlib import Path

import numpy as np
import pytest
import torch
from compared_cases import Case, case_of

from liveview_ref import onnx_session
from liveview_ref.export import export
from liveview_ref.parity import stage_cases, stages
from liveview_ref.reference.guided import COARSE_CELL, WINDOWS
from liveview_ref.reference.layers import CELL
from liveview_ref.reference.liveview import view_distances

MOST_DIFFERENT = 1e-4  # of the final frames of Rust, of float32 torch and of the oracle, in [0, 1]

torch.set_num_threads(1)  # small arrays


@pytest.fixture(scope="module")
def models(tmp_path_factory) -> dict[int, Path]:
    """A seeded, untrained network for each V. The oracle's has its BatchNorms, in the exported one
    they are folded."""
    folder, found = tmp_path_factory.mktemp("models"), {}
    for views in {views for views, _, _ in stage_cases.CASES.values()}:
        found[views] = folder / f"network_v{views}.onnx"
        about = {"recommended_layers": "guided:4", "training": "none: seeded", "licence": "MIT"}
        export(stage_cases.network(views).float(), found[views], about)
    return found


@pytest.fixture(scope="module", params=stage_cases.CASES)
def case(request) -> Case:
    return case_of(request.param)


GUIDED = [name for name, (_, _, layers) in stage_cases.CASES.items() if isinstance(layers, int)]


def test_homography_and_maps(inner, case):
    if "disparities" not in case.data:
        case.check(stages.maps, maps=inner.upsample_maps(case.data["cell_maps"]))
        return
    planes = case.data["disparities"]
    case.check(stages.maps, maps=inner.plane_maps(case.target, planes))
    found = [[inner.source_from_target(camera, case.target, d) for camera in case.cameras] for d in planes]
    case.check(stages.homography, homography=found)


@pytest.mark.parametrize("name", GUIDED)
def test_guided_search(inner, name):
    case = case_of(name)
    data, planes, rig = case.data, case.data["coarse_disparities"], (case.images, case.cameras, case.target)
    found = inner.search_planes(*rig, stage_cases.NEAR, stage_cases.FAR)
    assert found == planes.tolist()
    maps = np.ascontiguousarray(stages.planes_of_search(data, data["costs"].shape, torch.float32))
    case.check(stages.costs, costs=inner.layer_costs(*rig, maps, COARSE_CELL, WINDOWS[0]))
    case.check(stages.aggregated_costs, aggregated_costs=inner.semi_global(data["costs"]))
    found = inner.winner_takes_all(data["aggregated_costs"], maps)
    case.check(stages.coarse_disparity, coarse_disparity=found)
    found = inner.fine_layers(data["coarse_disparity"], float(planes[0] - planes[1]) / 2)
    case.check(stages.fine_layers, fine_layers=found)
    found = inner.layer_costs(*rig, data["fine_layers"], CELL, WINDOWS[1])
    case.check(stages.fine_costs, fine_costs=found)
    found = inner.winner_takes_all(data["fine_costs"], data["fine_layers"])
    case.check(stages.fine_disparity, fine_disparity=found)
    found, cell_maps = inner.range_of(data["fine_disparity"], len(data["cell_maps"]))
    case.check(stages.ranges, range=found, cell_maps=cell_maps)


def test_logits_equal_onnxruntime(inner, case, models):
    net, model = stage_cases.network(len(case.cameras)), models[len(case.cameras)]
    found = inner.logits(model, case.data["colour"])
    case.check(lambda data, dtype: {"logits": stages.logits(net, data["colour"], dtype)}, logits=found)
    expected = onnx_session.logits(onnx_session.session(model, 1), case.data["colour"])
    assert found.tobytes() == expected.tobytes(), f"{(found != expected).sum()} of {found.size} logits differ"


@pytest.mark.parametrize("name", stage_cases.ALPHA_SPACINGS)
def test_blend_with_a_shift(inner, name):
    case = case_of(name)
    distances = view_distances(case.cameras, case.target)
    parts = case.logits, case.colour, case.coverage, distances, case.data["logit_shift"]
    alpha, rgb = inner.blend_shifted(*parts)
    case.check(stages.blended, alpha=alpha, rgb=rgb)


def end_to_end(case: Case, dtype: torch.dtype) -> np.ndarray:
    """The frame [3, H, W] from photos and layers alone, every stage in `dtype`."""
    given = ("disparities", "cell_maps", "alpha_scale", "alpha_spacing", "logit_shift")
    run = {name: value for name, value in case.data.items() if "." in name or name in given}
    net = stage_cases.network(len(case.cameras))
    for stage in (stages.maps, stages.warp, stages.blended, stages.composited):
        if stage is stages.blended:
            run["logits"] = stages.logits(net, run["colour"], dtype)
        run |= stage(run, dtype)
    return run["frame"]


def test_frame_for_any_batch_size(inner, case, models):
    data, rig = case.data, (case.images, case.cameras, case.target)
    layers = data.get("disparities", data.get("cell_maps"))
    alpha = {name: float(data[name][0]) for name in ("alpha_scale", "alpha_spacing") if name in data}
    (one, shifts), (three, _) = (
        inner.render(models[len(case.cameras)], *rig, layers, batch, **alpha) for batch in (1, 3)
    )
    assert one.tobytes() == three.tobytes()
    if "logit_shift" in data:
        case.check(stages.spacing, logit_shift=shifts)
    for dtype in (torch.float32, torch.float64):
        assert np.abs(np.moveaxis(one, -1, 0) - end_to_end(case, dtype)).max() <= MOST_DIFFERENT, dtype
