"""The wheel in an empty environment: its pictures are the program's, bit for bit."""

import subprocess
import sys

import pytest

from liveview_ref.paths import ROOT

PROGRAM = ROOT / "target/release/liveview"
SCENE = ROOT / "tests/scenes/workshop"
MODEL = ROOT / "models/liveview_v4.onnx"

# Arguments: the scene, a model, a folder for the pictures.
RENDER = """
import sys
import numpy as np
import liveview

folder, model, out = sys.argv[1:]
scene = liveview.Scene(folder)
liveview.Synthesizer(scene).render("target_0").save(f"{out}/folder.png")
liveview.Synthesizer(scene, network=model).render("target_0").save(f"{out}/network.png")

photos = np.stack([np.round(scene.photo(name) * 255).astype(np.uint8) for name in scene.names])
k, poses = (np.stack(found) for found in zip(*((camera.k, camera.pose()) for camera in scene.cameras)))
near, far = np.min(scene.depth_ranges, 0)[0], np.max(scene.depth_ranges, 0)[1]
np.savez(f"{out}/arrays.npz", photos=photos, k=k, poses=poses, names=scene.names, near=near, far=far)
arrays = np.load(f"{out}/arrays.npz")
scene = liveview.Scene.from_arrays(arrays["photos"], arrays["k"], arrays["poses"], names=list(arrays["names"]))
frame = liveview.Synthesizer(scene, near=arrays["near"], far=arrays["far"]).render("target_0")
frame.save(f"{out}/arrays.png")
print(float(arrays["near"]), float(arrays["far"]))
"""


@pytest.fixture(scope="module")
def environment(wheel, tmp_path_factory):
    """A Python that has the wheel, and of other packages only those that it needs."""
    folder = tmp_path_factory.mktemp("environment")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    pins = [line for name in ("requirements", "requirements-runtime") for line in lines(name) if named(line)]
    python = folder / "bin/python"
    install = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", *pins, wheel]
    subprocess.run(install, check=True)
    return python


def lines(name: str) -> list[str]:
    return (ROOT / f"python/{name}.txt").read_text().splitlines()


def named(line: str) -> bool:
    return line.split("==")[0] in ("numpy", "onnxruntime")


def rendered(out, *options: str) -> bytes:
    command = [PROGRAM, "render", SCENE, "--target", "target_0", "-o", out, *options]
    subprocess.run(command, check=True, capture_output=True)
    return out.read_bytes()


@pytest.mark.skipif(not PROGRAM.is_file(), reason="the program is not built (make build)")
def test_pictures_of_the_wheel_are_those_of_the_program(environment, tmp_path):
    command = [environment, "-c", RENDER, SCENE, MODEL, tmp_path]
    run = subprocess.run(command, cwd=tmp_path, env={}, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    near, far = run.stdout.split()
    assert (tmp_path / "folder.png").read_bytes() == rendered(tmp_path / "a.png", "--network", "none")
    assert (tmp_path / "network.png").read_bytes() == rendered(tmp_path / "b.png", "--model", str(MODEL))
    same_range = rendered(tmp_path / "c.png", "--network", "none", "--near", near, "--far", far)
    assert (tmp_path / "arrays.png").read_bytes() == same_range


def test_without_onnxruntime_a_network_is_refused_and_none_needed(environment, tmp_path):
    script = """
import sys, liveview
sys.modules["onnxruntime"] = None
import importlib.util
importlib.util.find_spec = lambda name: None
scene = liveview.Scene(sys.argv[1], width=84)
try:
    liveview.Synthesizer(scene, network=sys.argv[2])
except liveview.Error as error:
    assert "ONNX Runtime" in str(error), error
else:
    raise SystemExit("a network without ONNX Runtime")
assert liveview.Synthesizer(scene).render("target_0").picture.shape == (59, 84, 3)
"""
    run = subprocess.run([environment, "-c", script, SCENE, MODEL], env={}, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
