"""The evaluation: its renderer equals the reference, its baselines, its files."""

import json
import struct
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import torch
from toy_rigs import rig_of

from liveview_ref.data import scene
from liveview_ref.data.held_out import Case
from liveview_ref.evaluation import baselines, chart, evaluate, methods
from liveview_ref.evaluation.lpips import load_lpips, lpips, weights_file
from liveview_ref.layer_spec import DisparityList, Guided, Planes, Select
from liveview_ref.reference.competing import composite_competing, cover_planes
from liveview_ref.reference.layers import warp_maps
from liveview_ref.reference.liveview import plane_histogram, render
from liveview_ref.reference.metrics import psnr

ROOT = Path(__file__).parents[3]


def case_of_rig(kind: str) -> Case:
    images, cameras, target = rig_of(kind)
    truth = torch.zeros(3, target.height, target.width)
    return Case([x.float() for x in images], cameras, target, truth, 1.0, 8.0, [])


def wall(disparity: float = 0.5) -> Case:
    """Views and target of a textured plane facing them."""
    case = case_of_rig("rectified")
    texture = torch.rand(1, 3, 256, 256, generator=torch.Generator().manual_seed(1))
    texture = torch.nn.functional.avg_pool2d(texture, 5, 1, 2)[0]
    painted = case.target.with_window(-100, -100, 256, 256)

    def seen(camera):
        return warp_maps(texture, painted, camera, torch.full((1, camera.height, camera.width), disparity))[0][0]

    return case._replace(sources=[seen(c) for c in case.cameras], truth=seen(case.target), near=1.5)


def test_streamed_layers_equal_the_reference_render():
    case = case_of_rig("random")
    maps = methods.maps_of(case, Planes(10))

    def network(hwv):
        return hwv[:, 2:6] * 4 - 2

    out, stages = render(network, *case[:3], maps[:, 0, 0])
    layers = methods.infer(network, case, maps)
    alpha, image = methods.composited(layers, maps)
    torch.testing.assert_close(image, out.rgb)
    expected = stages.alpha[:, : case.target.height, : case.target.width]
    assert torch.equal(plane_histogram(alpha), plane_histogram(expected))
    some = [1, 4, 7]
    image = methods.composited([x[some] for x in layers], maps[some])[1]
    torch.testing.assert_close(image, render(network, *case[:3], maps[some, 0, 0])[0].rgb)


def test_layers_without_network_are_made_from_their_spec():
    case = case_of_rig("random")
    listed = methods.maps_of(case, DisparityList((0.5, 0.25)))
    assert listed.shape == (2, 40, 56) and listed[:, 7, 9].tolist() == [0.5, 0.25]
    assert torch.equal(methods.maps_of(case, Guided(2)), methods.guided_maps_of(case)["guided:2"])
    with pytest.raises(ValueError, match="select:2/4: expected"):
        methods.maps_of(case, Select(2, 4))


def test_nearest_view_is_its_photo():
    case = case_of_rig("coincident")
    case = case._replace(target=case.cameras[0])
    ((_, image),) = baselines.nearest(case)
    assert torch.equal(image, case.sources[0])


def test_sweep_and_single_plane_find_a_textured_plane():
    case = wall()
    maps = torch.tensor([0.9, 0.7, 0.5, 0.3, 0.1])[:, None, None].expand(5, 40, 56)
    inner = (..., slice(4, -4), slice(4, -4))
    assert psnr(baselines.winning(case, maps)[inner], case.truth[inner]) > 30
    ((_, image),) = baselines.single_plane(case)
    assert psnr(image[inner], case.truth[inner]) > 30


def test_flow_interpolates_between_two_views():
    pytest.importorskip("cv2")
    case = wall()
    i, j, t = baselines.flanking(case.cameras, case.target)
    x = [float(c.centre[0]) for c in case.cameras]
    assert x[i] * x[j] < 0 and (1 - t) * x[i] + t * x[j] == pytest.approx(0, abs=1e-9)
    ((_, image),) = baselines.flow(case)
    inner = (..., slice(8, -8), slice(8, -8))
    assert psnr(image[inner], case.truth[inner]) > 25


def test_lpips_is_0_for_equal_images_and_grows_with_noise():
    try:
        weights_file()
    except ModuleNotFoundError as error:
        pytest.skip(str(error))
    generator = torch.Generator().manual_seed(0)
    image, noise = torch.rand(2, 3, 64, 80, generator=generator)
    found = [lpips(load_lpips(), (image + s * (noise - 0.5)).clamp(0, 1), image) for s in (0.0, 0.1, 0.3, 1.0)]
    assert found[0] == 0 and found == sorted(set(found))


def test_text_and_binary_colmap_are_read_alike(tmp_path):
    (tmp_path / "cameras.txt").write_text("# c\n1 PINHOLE 64 48 50 51 32 24\n2 SIMPLE_PINHOLE 64 48 60 32 24\n")
    (tmp_path / "points3D.txt").write_text("7 1 2 3 0 0 0 0.5 1 0\n9 -1 0 4 0 0 0 0.5\n")
    (tmp_path / "images.txt").write_text(
        "1 1 0 0 0 0.5 0 0 2 b.png\n3.5 4.5 7 1 1 -1\n2 0.6 0.8 0 0 0 0 1 1 a b.png\n\n"
    )
    cameras = struct.pack("<QiiQQ4diiQQ3d", 2, 1, 1, 64, 48, 50, 51, 32, 24, 2, 0, 64, 48, 60, 32, 24)
    points = struct.pack("<QQ3d3BdQ2i", 2, 7, 1, 2, 3, 0, 0, 0, 0.5, 1, 1, 0)
    points += struct.pack("<Q3d3BdQ", 9, -1, 0, 4, 0, 0, 0, 0.5, 0)
    images = struct.pack("<Qi7di6sQddqddq", 2, 1, 1, 0, 0, 0, 0.5, 0, 0, 2, b"b.png\0", 2, 3.5, 4.5, 7, 1, 1, -1)
    images += struct.pack("<i7di8sQ", 2, 0.6, 0.8, 0, 0, 0, 0, 1, 1, b"a b.png\0", 0)
    for name, data in {"cameras": cameras, "points3D": points, "images": images}.items():
        (tmp_path / f"{name}.bin").write_bytes(data)
    (cameras, *text), (same, *binary) = scene.colmap_text(tmp_path), scene.colmap_binary(tmp_path)
    assert text == binary and cameras.keys() == same.keys()
    assert all((cameras[i][0] == same[i][0]).all() and cameras[i][1] == same[i][1] for i in cameras)


def test_figure_has_three_curves():
    names = ["guided:2", "guided:4", "planes:8", "planes:64", "select:8/64", "sweep, planes:64"]
    mean = {name: {"psnr": 20.0 + i, "ssim": 0.5 + i / 100} for i, name in enumerate(names)}
    assert chart.curves(mean, "psnr")["selected of 64 planes"] == [(8, 24.0), (64, 23.0)]
    drawing = ElementTree.fromstring(chart.figure(mean))
    assert len([x for x in drawing if x.tag.endswith("polyline")]) == 6
    ElementTree.fromstring(chart.figure({}))


def test_evaluation_writes_its_files_and_reports_skipped_scenes(tmp_path, monkeypatch):
    workshop = {"path": "tests/scenes/workshop", "width": 96, "targets": [7, 8]}
    spec = [
        {"name": "few", "pool": [0, 1], **workshop},
        {"name": "workshop", **workshop},
        {"path": "no", "targets": [0]},
    ]
    (tmp_path / "spec.json").write_text(json.dumps(spec))
    monkeypatch.setattr(evaluate, "load_lpips", lambda: None)
    monkeypatch.setattr(evaluate, "lpips", lambda weights, image, truth: 0.5)
    command = ["", ROOT / "models" / "liveview_v4.pt", tmp_path / "spec.json", "--data", tmp_path]
    command += ["--out", tmp_path / "out", "--methods", "guided,nearest", "--threads", "1"]
    monkeypatch.setattr(sys, "argv", [str(x) for x in command])
    threads = torch.get_num_threads()
    assert evaluate.main() == 0
    torch.set_num_threads(threads)
    report = json.loads((tmp_path / "out" / "scores.json").read_text())
    assert list(report["skipped"]) == ["few, images/target_0.jpg", "few, images/target_1.jpg", "no"]
    targets = report["scenes"]["workshop"]["targets"]
    assert [t["target"] for t in targets] == ["images/target_0.jpg", "images/target_1.jpg"]
    assert not any("target" in view for t in targets for view in t["views"])
    assert report["mean"]["guided:4"]["psnr"] > report["mean"]["nearest view"]["psnr"] + 3
    assert (tmp_path / "out" / "sheet.jpg").stat().st_size > 1000
    assert "| guided:4 |" in (tmp_path / "out" / "scores.md").read_text()


def test_competing_planes_equal_the_composite_of_all_at_once():
    case = case_of_rig("random")

    def network(hwv):
        return hwv[:, 2:6] * 4 - 2

    found = dict(methods.competing(network, case, 2.0, (4, 10)))
    assert list(found) == ["competing, planes:4", "competing, select:4/10", "competing, planes:10"]
    maps = methods.maps_of(case, Planes(10))
    stages = render(network, *case[:3], maps[:, 0, 0])[1]
    covered = (stages.coverage > 0).any(1)
    whole = composite_competing(stages.logits[:, 0], stages.rgb, covered, maps, 2.0)
    crop = (..., slice(case.target.height), slice(case.target.width))
    torch.testing.assert_close(found["competing, planes:10"], whole.rgb[crop])
    ids = cover_planes(plane_histogram(whole.weights[crop]), 4)
    few = composite_competing(stages.logits[ids, 0], stages.rgb[ids], covered[ids], maps[ids], 2.0)
    torch.testing.assert_close(found["competing, select:4/10"], few.rgb[crop])


def test_loaded_model_reports_its_training():
    about = evaluate.load_model(ROOT / "models" / "liveview_v4.pt")[2]
    assert about["alpha"] == "independent" and about["steps"] > 0
