"""Ctrl-C, a fork and the end of the interpreter while pictures are rendered."""

import os
import signal
import subprocess
import sys
import time

import pytest

from liveview_ref.paths import ROOT

WORKSHOP = ROOT / "tests/scenes/workshop"

# Arguments: the scene, a model or nothing. A signal arrives during the search or the network's run.
INTERRUPTED = """
import os, signal, sys, threading
import liveview

folder, model = sys.argv[1:]
scene = liveview.Scene(folder, width=168)
kill = lambda: os.kill(os.getpid(), signal.SIGINT)
if model:
    options = {"network": model, "layers": "planes:4000"}
    threading.Timer(1.5, kill).start()
else:
    options = {"progress": lambda done, count, name: kill() if done == 1 and not ended else None}
ended = False
synthesizer = liveview.Synthesizer(scene, **options)
try:
    synthesizer.render("target_0")
except KeyboardInterrupt:
    ended = True
assert ended, "no KeyboardInterrupt"
if model:
    synthesizer.depth(0)  # the network is opened again
    print("opened again")
else:
    frame = synthesizer.render("target_0")
    assert frame.picture.tobytes() == liveview.Synthesizer(scene).render("target_0").picture.tobytes()
    print("rendered again")
"""

# Argument: the scene. The signal arrives while a call waits for another thread's picture.
WAITING = """
import os, signal, sys, threading, time
import liveview

def progress(done, count, name):
    searching.set()
    if done == 1:
        time.sleep(0.3)
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.3)

searching, found, ended = threading.Event(), [], False
synthesizer = liveview.Synthesizer(liveview.Scene(sys.argv[1], width=168), progress=progress)
other = threading.Thread(target=lambda: found.append(synthesizer.render("target_0")))
other.start()
searching.wait()
try:
    synthesizer.render("target_0")
except KeyboardInterrupt:
    ended = True
other.join()
assert ended, "no KeyboardInterrupt"
assert found, "the other thread's picture was ended"
"""

# Argument: the scene. A frame of a path is finished after the signal, and dropped.
DROPPED = """
import os, signal, sys, threading
import liveview

scene = liveview.Scene(sys.argv[1], width=168)
frames = liveview.Synthesizer(scene, layers="planes:1000").render_path(scene.path("circle:2"))
ended = False
threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
try:
    next(frames)
except KeyboardInterrupt:
    ended = True
assert ended, "no KeyboardInterrupt"
assert next(frames).name == "frame_0000"
"""

# Argument: the scene. Threads are not forked.
FORKED = """
import os, sys
import liveview

synthesizer = liveview.Synthesizer(liveview.Scene(sys.argv[1], width=168), layers="planes:2")
synthesizer.render("target_0")
child = os.fork()
if child == 0:
    try:
        synthesizer.render("target_0")
    except RuntimeError as error:
        os._exit(7 if "spawn" in str(error) else 8)
    os._exit(9)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
synthesizer.render("target_0")
"""

# Argument: the scene. The interpreter exits while a daemon thread searches.
DAEMON = """
import sys, threading
import liveview

searching = threading.Event()
synthesizer = liveview.Synthesizer(liveview.Scene(sys.argv[1]), progress=lambda *_: searching.set())
threading.Thread(target=lambda: synthesizer.render("target_0"), daemon=True).start()
searching.wait()
"""


def run_script(liveview, script: str, *arguments: str) -> subprocess.CompletedProcess:
    environment = os.environ | {"PYTHONPATH": os.path.dirname(os.path.dirname(liveview.__file__))}
    command = [sys.executable, "-c", script, str(WORKSHOP), *arguments]
    # A shell ignores the signal for its background jobs, and Python leaves it so.
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("network", ["", str(ROOT / "models/liveview_v4_planes.onnx")])
def test_ctrl_c_ends_a_picture_and_the_next_one_is_whole(liveview, network):
    started = time.monotonic()
    run = run_script(liveview, INTERRUPTED, network)
    assert run.returncode == 0 and "again" in run.stdout, run.stderr
    assert time.monotonic() - started < 60


@pytest.mark.parametrize("script", [WAITING, DROPPED, FORKED, DAEMON], ids=["waiting", "dropped", "forked", "daemon"])
def test_only_the_call_ends_that_must(liveview, script):
    for _ in range(3 if script is DAEMON else 1):
        run = run_script(liveview, script)
        assert (run.returncode, run.stderr) == (0, "")
