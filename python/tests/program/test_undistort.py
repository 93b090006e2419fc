"""The library undistorts photos as the reference does."""

import json

import numpy as np
import pytest
import torch
from PIL import Image

from liveview_ref.data.scene import distortion, load_transforms
from liveview_ref.reference.undistort import undistort

SIZE = 64, 48
liveview = pytest.importorskip("liveview_ref.extension", exc_type=ImportError).liveview


@pytest.mark.parametrize(
    "lens",
    [
        {"k1": 0.06, "k2": -0.08, "k3": 0.01, "p1": -0.001, "p2": 0.0002},
        {"camera_model": "FULL_OPENCV", "k1": 0.3, "k2": 0.1, "k4": 0.25, "k5": 0.05, "k6": 0.01, "p2": 0.002},
        {"camera_model": "OPENCV_FISHEYE", "k1": 0.05, "k2": -0.02, "k3": 0.01, "k4": -0.002},
        {"is_fisheye": True},
    ],
)
def test_photos_are_undistorted_as_in_float64(tmp_path, lens):
    rng = np.random.default_rng(7)
    (tmp_path / "images").mkdir()
    frames = []
    for x in range(3):
        pixels = rng.integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
        Image.fromarray(pixels).save(tmp_path / "images" / f"{x}.png")
        pose = [[1, 0, 0, 0.1 * x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        frames.append({"file_path": f"images/{x}.png", "transform_matrix": pose})
    camera = {"fl_x": 40, "fl_y": 42, "cx": 31, "cy": 25, "w": SIZE[0], "h": SIZE[1], "near": 1, "far": 9, **lens}
    (tmp_path / "transforms.json").write_text(json.dumps({**camera, "frames": frames}))
    scene = load_transforms(tmp_path)
    assert scene.distortion == distortion(lens)
    for index in range(3):
        with Image.open(tmp_path / scene.names[index]) as photo:
            image = torch.from_numpy(np.array(photo)).permute(2, 0, 1).double() / 255
        expected = undistort(image, scene.cameras[index].k, scene.distortion)
        found = torch.from_numpy(liveview.Scene(tmp_path).photo(index)).permute(2, 0, 1)
        assert (found - expected).abs().max() < 1e-5
        assert (expected - image).abs().max() > 0.1
