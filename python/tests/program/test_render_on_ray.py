"""Shards on a local Ray with two workers, one of which is killed: the pictures equal those of a
single run."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
SCENE = ROOT / "tests" / "scenes" / "workshop"
PYTHON = ROOT / ".venv-ray" / "bin" / "python"
LIVEVIEW = ROOT / "target" / "release" / "liveview"
JOB = ["--path", "circle:24", "--network", "none", "--width", "252"]
CPUS = max(1, (os.cpu_count() or 1) // 2)  # of a shard, so that two run at a time

pytestmark = [
    pytest.mark.skipif(not PYTHON.exists(), reason="needs `make setup WITH=ray`"),
    pytest.mark.skipif(not LIVEVIEW.exists(), reason="needs `make build`"),
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc"),
]


def pictures(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in sorted(folder.glob("*.png"))}


def parent_of(child: int) -> int:
    """The id of the process that started this one."""
    return int(Path(f"/proc/{child}/stat").read_text().rsplit(")", 1)[1].split()[1])


def shards_that_run(output: Path) -> list[int]:
    """Process ids of the renders into this folder."""
    found = []
    for process in Path("/proc").iterdir():
        if not process.name.isdigit():
            continue
        try:
            words = process.joinpath("cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if words[0] == str(LIVEVIEW).encode() and b"render" in words and str(output).encode() in words:
            found.append(int(process.name))
    return found


def on_ray(output: Path, *options: str) -> subprocess.Popen:
    command = [str(PYTHON), "-m", "tools.render_on_ray", str(SCENE), "-o", str(output), *options]
    environment = {**os.environ, "RAY_USAGE_STATS_ENABLED": "0", "RAY_worker_niceness": "0"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, cwd=ROOT / "python", env=environment, **pipes)


def test_killed_worker_is_replaced(tmp_path):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    one = [str(LIVEVIEW), "render", str(SCENE), "-o", str(whole), "--threads=1", *JOB]
    subprocess.run(one, check=True, capture_output=True)
    driver = on_ray(parts, "--shards=4", f"--cpus={CPUS}", f"--join={tmp_path / 'table.json'}", "--", *JOB)
    shards = []
    while not shards:
        assert driver.poll() is None, driver.communicate()
        shards = shards_that_run(parts)
        time.sleep(0.005)
    worker = parent_of(shards[0])
    os.kill(worker, signal.SIGKILL)
    os.kill(shards[0], signal.SIGKILL)  # as if the whole machine failed
    output, errors = driver.communicate(timeout=600)
    assert driver.returncode == 0, errors
    assert "died; try 1 of 3" in errors, errors
    assert "(4 of 4 shards" in errors and "24 pictures of 4 shards, complete" in output, (output, errors)
    assert len(pictures(whole)) == 24 and pictures(whole) == pictures(parts)


def test_failing_command_is_not_repeated(tmp_path):
    driver = on_ray(tmp_path / "parts", "--shards=2", "--", "--path", "no such path")
    _, errors = driver.communicate(timeout=600)
    assert driver.returncode == 2, errors
    assert "try 1" not in errors and "error: 2 of 2 shards failed" in errors and "no such path" in errors, errors
