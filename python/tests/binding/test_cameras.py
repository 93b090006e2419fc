"""Cameras to and from other programs, and pictures as torch tensors."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from liveview_ref.paths import ROOT

RIG = ROOT / "tests/scenes/rig"


@pytest.fixture(scope="module")
def cameras(liveview):
    return liveview.cameras


@pytest.fixture(scope="module", params=[0.0, 1e-9, 0.3, 2.0, np.pi - 1e-9, np.pi])
def camera(liveview, request):
    """A camera that is turned by an angle."""
    axis = np.array([2.0, -1, 0.5]) / np.linalg.norm([2.0, -1, 0.5])
    turn = torch.linalg.matrix_exp(
        request.param * torch.tensor([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    )
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, (0.3, -1, 2)
    return liveview.Camera([[700, 0, 320.5], [0, 650, 240.25], [0, 0, 1]], pose, 640, 480)


def same(found, expected) -> None:
    np.testing.assert_allclose(found.k, expected.k)
    np.testing.assert_allclose(found.pose(), expected.pose(), atol=1e-9)
    assert (found.width, found.height) == (expected.width, expected.height)


def test_cameras_return_from_every_program(cameras, camera):
    same(cameras.from_colmap(*cameras.to_colmap(camera), 640, 480), camera)
    k, rvec, tvec = cameras.to_opencv(camera)
    same(cameras.from_opencv(k, rvec, tvec, 640, 480), camera)
    transforms = json.loads(json.dumps(cameras.to_nerfstudio({"a.png": camera})))
    same(cameras.from_nerfstudio(transforms)["a.png"], camera)


def test_opencv_projects_as_the_camera(cameras, camera):
    cv2 = pytest.importorskip("cv2")
    k, rvec, tvec = cameras.to_opencv(camera)
    points = np.random.default_rng(2).normal(0, 1, (9, 3))
    seen = points @ camera.rotation.T + camera.translation
    expected = (seen @ camera.k.T)[:, :2] / seen[:, 2:]
    np.testing.assert_allclose(cv2.projectPoints(points, rvec, tvec, k, None)[0][:, 0], expected, rtol=1e-6)


def test_nerfstudio_s_file_gives_the_cameras_of_the_scene(liveview, cameras):
    scene = liveview.Scene(RIG)
    read = cameras.from_nerfstudio(json.loads((RIG / "transforms.json").read_text()))
    for name, camera in zip(scene.names, scene.cameras, strict=True):
        same(next(found for file, found in read.items() if file.endswith(name)), camera)


def test_the_library_reads_what_is_written_for_other_programs(liveview, cameras, workshop, tmp_path):
    """Its readers of nerfstudio's and COLMAP's files know nothing of this module."""
    for name in ("nerfstudio", "colmap/sparse"):
        (tmp_path / name).mkdir(parents=True)
    written = {f"images/{name}": camera for name, camera in zip(workshop.names, workshop.cameras, strict=True)}
    (tmp_path / "nerfstudio/transforms.json").write_text(json.dumps(cameras.to_nerfstudio(written)))
    intrinsics, poses = [], []
    for index, (path, camera) in enumerate(written.items(), 1):
        qvec, tvec, params = cameras.to_colmap(camera)
        intrinsics.append(" ".join(str(x) for x in [index, "PINHOLE", camera.width, camera.height, *params]))
        poses.append(" ".join(str(x) for x in [index, *qvec, *tvec, index, Path(path).name]) + "\n")
        for program in ("nerfstudio", "colmap"):
            file = (tmp_path / program / path).with_suffix(".jpg")
            file.parent.mkdir(exist_ok=True)
            Image.new("RGB", (camera.width, camera.height)).save(file)
    (tmp_path / "colmap/sparse/cameras.txt").write_text("\n".join(intrinsics))
    (tmp_path / "colmap/sparse/images.txt").write_text("\n".join(poses))
    for program in ("nerfstudio", "colmap"):
        scene = liveview.Scene(tmp_path / program)
        assert len(scene) == len(written)
        for found, expected in zip(scene.cameras, written.values(), strict=True):
            same(found, expected)


def test_wrong_cameras_are_named(liveview, cameras, camera):
    for transforms, text in [({"k1": 0.1}, "k1"), ({"fl_x": 5}, "no cx")]:
        with pytest.raises(ValueError, match=text):
            cameras.from_nerfstudio({"frames": [{"file_path": "a.png"}], **transforms})
    with pytest.raises(ValueError, match="qvec"):
        cameras.from_colmap([0, 0, 0, 0], [0, 0, 0], [1, 1, 1, 1], 2, 2)
    skewed = liveview.Camera([[700, 1, 320], [0, 650, 240], [0, 0, 1]], np.eye(4), 640, 480)
    with pytest.raises(ValueError, match="skew"):
        cameras.to_colmap(skewed)


def test_arrays_are_undistorted_as_a_scene_is(liveview, tmp_path):
    photo = np.random.default_rng(3).integers(0, 256, (48, 64, 3), np.uint8)
    Image.fromarray(photo).save(tmp_path / "a.png")
    k, lens = [[50, 0, 30], [0, 60, 25], [0, 0, 1]], {"k1": 0.1, "k2": 0.02, "p1": 0.01, "p2": 0.003, "k3": 0.05}
    of_file = {"fl_x": 50, "fl_y": 60, "cx": 30, "cy": 25, "frames": [{"file_path": "a.png"}]}
    of_file["frames"][0]["transform_matrix"] = np.eye(4).tolist()
    (tmp_path / "transforms.json").write_text(json.dumps(lens | of_file))
    np.testing.assert_array_equal(liveview.undistort(photo, k, [*lens.values()]), liveview.Scene(tmp_path).photo(0))
    with pytest.raises(ValueError, match="distortion: 5 numbers; expected 4, 5 or 8, of a fisheye 4"):
        liveview.undistort(photo, k, [*lens.values()], fisheye=True)


def test_frames_are_torch_tensors_without_a_copy(liveview, workshop):
    frame = liveview.Synthesizer(workshop).render("target_0")
    for array in (frame.picture, frame.disparity, frame.transmittance, frame.raw):
        tensor = torch.from_dlpack(array)
        tensor[0, 0] = 0.25
        assert tensor.dtype == torch.float32 and (array[0, 0] == 0.25).all()


def test_torch_tensors_are_arguments(liveview, workshop, arrays):
    tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}
    scene = liveview.Scene.from_arrays(**tensors, names=workshop.names)
    assert scene.cameras == workshop.cameras
    np.testing.assert_array_equal(scene.photo(0), arrays["photos"][0])
