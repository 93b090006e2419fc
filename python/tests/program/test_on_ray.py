"""A path on a local Ray of two workers, one of which is killed: its frames are the program's."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from liveview_ref.paths import ROOT

SCENE = ROOT / "tests" / "scenes" / "workshop"
PYTHON = ROOT / ".venv-ray" / "bin" / "python"
LIVEVIEW = ROOT / "target" / "release" / "liveview"
PATH = "circle:10"

pytestmark = [
    pytest.mark.skipif(not PYTHON.exists(), reason="needs `make setup WITH=ray`"),
    pytest.mark.skipif(not LIVEVIEW.exists(), reason="needs `make build`"),
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc"),
]


def workers(packages: str) -> list[int]:
    """Process ids of the Ray workers of this test that have a renderer."""
    found = []
    for process in Path("/proc").iterdir():
        if not process.name.isdigit():
            continue
        try:
            title, variables = (process.joinpath(name).read_bytes() for name in ("cmdline", "environ"))
        except OSError:
            continue
        if title.startswith(b"ray::") and b"Renderer" in title and f"PYTHONPATH={packages}".encode() in variables:
            found.append(int(process.name))
    return sorted(found)


def test_killed_worker_is_replaced(tmp_path):
    packages = pytest.importorskip("liveview_ref.extension", exc_type=ImportError).FOLDER.name
    whole, out = tmp_path / "whole", tmp_path / "out"
    one = [LIVEVIEW, "render", SCENE, "-o", whole, "--path", PATH, "--network", "none", "--width", "168"]
    subprocess.run(one, check=True, capture_output=True)
    command = [PYTHON, ROOT / "crates/python/examples/on_ray.py", SCENE, PATH, out, "--workers=2", "--width=168"]
    environment = {**os.environ, "PYTHONPATH": packages, "RAY_USAGE_STATS_ENABLED": "0"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen(command, env=environment, **pipes) as driver:
        output = ""
        while "1 of 10" not in output:
            line = driver.stdout.readline()
            assert line, output
            output += line
        running = workers(packages)
        assert running, output
        os.kill(running[0], signal.SIGKILL)
        output += driver.stdout.read()
    assert driver.returncode == 0, output
    names = sorted(file.name for file in whole.glob("*.png"))
    assert len(names) == 10 and "10 of 10" in output
    assert [name for name in names if (out / name).read_bytes() != (whole / name).read_bytes()] == []
