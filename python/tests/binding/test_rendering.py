"""Rendering from Python: threads, progress, paths, the example, and what the binding costs."""

import copy
import json
import os
import pickle
import shutil
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from liveview_ref.paths import ROOT

WORKSHOP = ROOT / "tests/scenes/workshop"
RIG = ROOT / "tests/scenes/rig"


def bits(frame) -> bytes:
    return frame.picture.tobytes() + frame.disparity.tobytes() + frame.transmittance.tobytes()


def test_a_scene_from_arrays_gives_the_same_bits(liveview, workshop, arrays):
    ranges = {"near": 1.2, "far": 7.7}
    expected = bits(liveview.Synthesizer(workshop, **ranges).render("target_0"))
    for photos in (arrays["photos"], list(arrays["photos"])):
        scene = liveview.Scene.from_arrays(photos, arrays["k"], arrays["poses"], names=workshop.names)
        assert bits(liveview.Synthesizer(scene, **ranges).render("target_0")) == expected


def test_both_conventions_give_the_same_camera(liveview, workshop):
    for camera in workshop.cameras:
        opengl = camera.pose("opengl")
        again = liveview.Camera(camera.k, opengl, camera.width, camera.height, convention="opengl")
        np.testing.assert_allclose(again.pose(), camera.pose(), atol=1e-14)
        np.testing.assert_allclose(opengl[:3, 3], camera.centre)
        np.testing.assert_array_equal(opengl[:3, 1], -camera.rotation[1])
        assert pickle.loads(pickle.dumps(camera)) == camera == copy.deepcopy(camera)


def test_ten_pictures_in_four_threads_have_the_same_bits(liveview, workshop):
    targets = [*workshop.path("circle:5"), *workshop.cameras[:5]]
    shared, alone = liveview.Synthesizer(workshop), liveview.Synthesizer(workshop)
    expected = [bits(alone.render(target)) for target in targets]
    own = threading.local()

    def by_own(target) -> bytes:
        if not hasattr(own, "synthesizer"):
            own.synthesizer = liveview.Synthesizer(workshop)
        return bits(own.synthesizer.render(target))

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda target: bits(shared.render(target)), targets)) == expected
        assert list(pool.map(by_own, targets)) == expected


def test_threads_render_at_the_same_time(liveview, workshop):
    """A search waits for a picture that another thread makes meanwhile."""
    made = threading.Event()
    waiting = liveview.Synthesizer(workshop, progress=lambda *_: made.wait(60) or pytest.fail("not in parallel"))
    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(waiting.render, "target_0")
        second = liveview.Synthesizer(workshop).render("target_0")
        made.set()
        assert bits(first.result()) == bits(second)


def test_progress_is_called_for_each_photo_and_its_exception_ends_the_search(liveview, workshop):
    calls = []
    synthesizer = liveview.Synthesizer(workshop, progress=lambda *call: calls.append(call))
    synthesizer.render("target_0")
    assert [done for done, _, _ in calls] == list(range(calls[0][1]))
    assert all(name in workshop.names for _, _, name in calls)

    def failing(done, count, name):
        if done == 1:
            raise KeyError(name)

    with pytest.raises(KeyError):
        liveview.Synthesizer(workshop, progress=failing).render("target_0")
    nested = liveview.Synthesizer(workshop, progress=lambda *_: nested.render("target_0"))
    with pytest.raises(RuntimeError, match="progress"):
        nested.render("target_0")


def test_path_and_depth(liveview, workshop):
    synthesizer = liveview.Synthesizer(workshop)
    frames = synthesizer.render_path(workshop.path("circle:3"))
    assert len(frames) == 3
    found = list(frames)
    assert [frame.name for frame in found] == ["frame_0000", "frame_0001", "frame_0002"]
    assert all(np.isfinite(frame.picture).all() and frame.uncovered < 0.1 for frame in found)
    depth = synthesizer.depth("source_0")
    assert depth.disparity.shape == depth.confirmed.shape == workshop.photo(0).shape[:2]
    near, far = depth.range
    sure = depth.disparity[depth.confirmed]
    assert depth.confirmed.mean() > 0.5 and (1 / far * 0.99 < sure).all() and (sure < 1 / near * 1.01).all()


def test_a_baked_page_holds_the_scene_and_is_written_whole_or_not_at_all(liveview, workshop, tmp_path):
    page = tmp_path / "page.html"
    assert liveview.bake(workshop, page, held_out=["target_0"]) == []
    text = page.read_text()
    described = json.loads(text.split('id="scene">', 1)[1].split("</script>", 1)[0])
    assert [view["name"] for view in described["views"]] == workshop.names
    assert [bool(view["depth"]) for view in described["views"]] == [name != "target_0.jpg" for name in workshop.names]
    page.unlink()
    with pytest.raises(liveview.Error, match="two photos take more"):
        liveview.bake(workshop, page, max_mb=0.01)
    with pytest.raises(ValueError, match="max_mb"):
        liveview.bake(workshop, page, max_mb=0)
    assert not page.exists()


def test_depths_are_searched_once(liveview, workshop):
    searched = []
    synthesizer = liveview.Synthesizer(workshop, progress=lambda _done, _count, name: searched.append(name))
    for name in workshop.names:
        synthesizer.depth(name)
    synthesizer.render(workshop.cameras[0])
    assert sorted(searched) == sorted(workshop.names)


def test_a_frame_that_failed_comes_again(liveview, workshop):
    failures = [KeyError("once")]

    def failing(*_):
        if failures:
            raise failures.pop()

    frames = liveview.Synthesizer(workshop, progress=failing).render_path(workshop.path("circle:2"))
    with pytest.raises(KeyError):
        next(frames)
    assert [frame.name for frame in frames] == ["frame_0000", "frame_0001"]


def test_threads_render_a_path_on_the_same_planes(liveview, workshop):
    path = workshop.path("circle:4")

    def frames():
        return liveview.Synthesizer(workshop, layers="select:4/16").render_path(path)

    shared = frames()
    with ThreadPoolExecutor(4) as pool:
        found = [pool.submit(next, shared) for _ in path]
    assert {frame.result().name: bits(frame.result()) for frame in found} == {f.name: bits(f) for f in frames()}


@pytest.mark.parametrize("layers", ["surface:1", "planes:6", "select:4/16"])
def test_any_frame_of_a_path_is_that_of_the_whole(liveview, workshop, layers):
    path = workshop.path("circle:4")
    frames = [liveview.Synthesizer(workshop, layers=layers).render_path(path) for _ in range(2)]
    assert [(f.name, bits(f)) for f in frames[0]][2] == (frames[1][2].name, bits(frames[1][2]))
    with pytest.raises(IndexError, match="the path has 4"):
        frames[1][4]


def compare(liveview, *arguments) -> subprocess.CompletedProcess:
    environment = os.environ | {"PYTHONPATH": os.path.dirname(os.path.dirname(liveview.__file__)), "MPLBACKEND": "Agg"}
    command = [sys.executable, ROOT / "crates/python/examples/compare.py", *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True)


def test_example_runs(liveview, tmp_path):
    without_targets = tmp_path / "scene"
    shutil.copytree(RIG, without_targets)
    transforms = json.loads((RIG / "transforms.json").read_text())
    transforms["frames"] = [frame for frame in transforms["frames"] if not frame["file_path"].startswith("target")]
    (without_targets / "transforms.json").write_text(json.dumps(transforms))
    for scene in (WORKSHOP, without_targets):
        run = compare(liveview, scene, tmp_path)
        assert run.returncode == 0 and "dB" in run.stdout, run.stderr
        assert (tmp_path / "picture.png").is_file()
    run = compare(liveview)
    assert run.returncode == 2 and "usage" in run.stderr, run.stderr
