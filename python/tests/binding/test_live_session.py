"""Live sessions: the program's frames, and what a step reuses of the one before."""

import subprocess

import numpy as np
import pytest
from PIL import Image

from liveview_ref.paths import BINARY, ROOT

RIG = ROOT / "tests/scenes/rig"
STEPS = 3
RANGE = 1.2, 7.2  # as in its transforms.json


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """The first steps of the example rig as PNG files, which all decoders read alike."""
    folder = tmp_path_factory.mktemp("rig")
    for camera in sorted(path for path in RIG.iterdir() if path.is_dir()):
        (folder / camera.name).mkdir()
        for step in range(STEPS):
            Image.open(camera / f"{step:04}.jpg").save(folder / camera.name / f"{step:04}.png")
    (folder / "transforms.json").write_text((RIG / "transforms.json").read_text().replace(".jpg", ".png"))
    return folder


@pytest.fixture(scope="module")
def rig(liveview, clip):
    """The cameras, the target's last, and the photos of each step; the target has none."""
    scene = liveview.Scene(clip)
    folders = [name.split("/")[0] if "/" in name else None for name in scene.names]
    if None in folders:
        folders = sorted(path.name for path in clip.iterdir() if path.is_dir())

    def photo(folder: str, step: int) -> np.ndarray | None:
        return None if folder == "target" else np.asarray(Image.open(clip / folder / f"{step:04}.png"))

    target = folders.index("target")
    return scene.cameras, scene.cameras[target], [[photo(f, step) for f in folders] for step in range(STEPS)]


def bits(frame) -> bytes:
    return frame.picture.tobytes() + frame.disparity.tobytes() + frame.transmittance.tobytes()


@pytest.mark.skipif(not BINARY.is_file(), reason="the program is not built (make build)")
def test_frames_are_those_of_the_program(liveview, clip, rig, tmp_path):
    subprocess.run([BINARY, "video", clip, "--camera", "target", "-o", tmp_path / "program"], check=True)
    cameras, target, steps = rig
    session = liveview.LiveSession(cameras, *RANGE)
    written = sorted((tmp_path / "program").iterdir())
    assert len(written) == STEPS
    for step, (photos, expected) in enumerate(zip(steps, written, strict=True)):
        frame = session.render(photos, target)
        assert frame.name == f"frame_{step:04}"
        assert list(frame.times) == ["photos", "layers", "warp", "network", "composite"]
        frame.save(tmp_path / "frame.png")
        assert (tmp_path / "frame.png").read_bytes() == expected.read_bytes(), step


def test_a_step_reuses_what_its_policy_says(liveview, rig):
    cameras, target, steps = rig

    def alone_by(policy):
        return liveview.LiveSession(cameras, *RANGE, policy=policy).render(steps[2], target)

    found = {}
    for policy in ("each", "once"):
        session = liveview.LiveSession(cameras, *RANGE, policy=policy)
        session.render(steps[0], target)
        found[policy] = bits(session.render(steps[2], target))
        session.restart()
        restarted = bits(session.render(steps[2], target))
        assert restarted == (found["each"] if policy == "each" else bits(alone_by(policy))), policy
    assert found["each"] != found["once"]


def test_a_camera_may_deliver_nothing(liveview, rig):
    cameras, target, steps = rig
    session = liveview.LiveSession(cameras, *RANGE, views=3)
    photos = [None, *steps[0][1:]]
    assert bits(session.render(photos, target)) != bits(session.render(steps[0], target))
    with pytest.raises(liveview.Error, match="views are needed"):
        session.render([*steps[0][:2], *[None] * (len(cameras) - 2)], target)


def test_hostile_steps_are_named_and_the_session_goes_on(liveview, rig):
    cameras, target, steps = rig
    session = liveview.LiveSession(cameras, *RANGE, layers="planes:2")
    expected = bits(session.render(steps[0], target))
    photos = steps[0]
    for kind, name, wrong in [
        (ValueError, "photos", photos[:-1]),
        (ValueError, "photos", []),
        (ValueError, "photos", [photos[0][:5], *photos[1:]]),
        (ValueError, r"photos\[1\]", [photos[0], photos[1][..., :2], *photos[2:]]),
        (TypeError, r"photos\[0\]", [photos[0].astype(np.float64), *photos[1:]]),
        (TypeError, r"photos\[0\]", ["a.png", *photos[1:]]),
        (TypeError, "photos", 3),
    ]:
        with pytest.raises(kind, match=name):
            session.render(wrong, target)
    with pytest.raises(TypeError, match="target"):
        session.render(photos, "target")
    assert bits(session.render(photos, target)) == expected
