"""`liveview poses`: what its script does around COLMAP; and, where pycolmap is installed, COLMAP on
the example scene."""

import importlib.util
import json
import math
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).parents[3]
SPEC = importlib.util.spec_from_file_location("_poses", ROOT / "crates/python/python/liveview/_poses.py")
poses = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(poses)


def quiet(**_):
    pass


def photo(path, size=(32, 24)):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", size, "grey").save(path)


def test_photos_are_linked_and_others_converted(tmp_path):
    for name in ("in/a.png", "in/cam 1/b.jpg", "in/c.gif", "in/notes.txt"):
        photo(tmp_path / name) if not name.endswith("txt") else (tmp_path / name).write_text("-")
    (tmp_path / "out").mkdir()
    assert poses.gather([tmp_path / "in"], tmp_path / "out", quiet) == []
    found = [str(path.relative_to(tmp_path / "out")) for path in poses.files_in(tmp_path / "out")]
    assert found == ["a.png", "c.jpg", "cam_1/b.jpg"]
    assert (tmp_path / "out/a.png").resolve() == tmp_path / "in/a.png"


@pytest.mark.parametrize(
    "inputs, words", [(["nowhere"], "does not exist"), (["in/notes.txt"], "cannot be converted"), ([], "no photos")]
)
def test_unusable_input_is_refused_in_words(tmp_path, monkeypatch, inputs, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    (tmp_path / "in/notes.txt").write_text("-")
    with pytest.raises(poses.Refused, match=words):
        poses.poses(inputs, "scene")
    assert [path.name for path in tmp_path.iterdir()] == ["in"], "nothing is left behind"
    (tmp_path / "in/scene").mkdir()
    (tmp_path / "in/scene/old").write_text("-")
    with pytest.raises(poses.Refused, match="expected a new folder"):
        poses.poses(["in"], "in/scene")


def test_pairs_of_many_photos_are_neighbours_and_loops():
    few = sum(poses.is_matched(a, b, 60) for a in range(60) for b in range(a + 1, 60))
    assert few == 60 * 59 // 2
    assert poses.is_matched(7, 17, 300) and not poses.is_matched(7, 18, 300) and poses.is_matched(0, 295, 300)


def test_transforms_have_the_poses_of_the_model(tmp_path):
    angle, translation = 0.3, (0.5, -0.25, 2.0)
    quaternion = (math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0)
    (tmp_path / "sparse/0").mkdir(parents=True)
    image = struct.pack("<I7dI", 4, *quaternion, *translation, 9) + b"a.jpg\0" + struct.pack("<Q", 1) + bytes(24)
    (tmp_path / "sparse/0/images.bin").write_bytes(struct.pack("<Q", 2) + image + image.replace(b"a.jpg", b"b.jpg"))
    camera = struct.pack("<IiQQ4d", 9, 2, 64, 48, 50.0, 31.0, 25.0, 0.01)
    (tmp_path / "sparse/0/cameras.bin").write_bytes(struct.pack("<Q", 1) + camera)
    registered = poses.registered_in(tmp_path / "sparse/0")
    assert list(registered) == ["a.jpg", "b.jpg"]
    poses.write_transforms(tmp_path, registered)
    frame = json.loads((tmp_path / "transforms.json").read_text())["frames"][1]
    assert (frame["file_path"], frame["fl_x"], frame["k1"]) == ("images/b.jpg", 50.0, 0.01)
    cam_from_world = np.linalg.inv(np.array(frame["transform_matrix"]) @ np.diag([1, -1, -1, 1]))
    sin, cos = math.sin(angle), math.cos(angle)
    assert np.allclose(cam_from_world[:3, :3], [[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    assert np.allclose(cam_from_world[:3, 3], translation)


def test_example_scene_is_registered(tmp_path):
    pytest.importorskip("pycolmap")
    found = poses.poses([ROOT / "tests/scenes/workshop/images"], tmp_path / "scene", quiet)
    assert found["photos"] == 9 and found["registered"] >= 8, found
    assert len(json.loads((tmp_path / "scene/transforms.json").read_text())["frames"]) == found["registered"]
    assert sys.modules["pycolmap"] and not list(tmp_path.glob(".liveview-tmp*"))
