"""One engine in a process of its own, driven line by line: python -m liveview_ref.worker

`liveview sweep` holds its own run time against that of other engines. It starts a worker for each, so that each has a
peak memory of its own, and asks them in turn, so that what else the machine does falls on all alike. One JSON object
per line, in and out; stdout carries nothing else, notes go to stderr. Relative paths are the worker's own.

    in   {"job": FILE.npz, "model": FILE.onnx, "weights": FILE.pt or null, "engine": NAME, "threads": 2, "batch": 1}
    out  {"ready": true, "engine": "the engine with its version"}
    in   {"run": true, "frame": FILE.npy}       `frame`, float32 [h, w, 3], may be left out; writing it is not timed
    out  {"seconds": {"warp": s, "network": s, "composite": s} or {"total": s}, "peak_memory_bytes": since the start}
    in   {"quit": true}, or the end of input
    out  {"error": "..."} after whatever fails, and exit code 2

The job's arrays are named as in stages.py: photos, cameras and the disparities of planes. NAME is one of engines.NAMES.
"""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TextIO

import numpy as np

from . import engines


def peak_memory() -> int:
    """Largest resident memory of this process so far, bytes (VmHWM)."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024


def private_stdout() -> TextIO:
    """The stream for replies; whatever else writes to stdout, in Python or below it, lands on stderr from now on."""
    replies = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    return replies


def serve(requests: TextIO, replies: TextIO) -> None:
    """Answer requests until told to quit."""

    def reply(**message) -> None:
        print(json.dumps(message), file=replies, flush=True)

    line = requests.readline()
    if not line:
        return
    engine = engines.start(engines.Job.of(json.loads(line)))
    reply(ready=True, engine=engine.title)
    for line in requests:
        request = json.loads(line)
        if request.get("quit"):
            return
        if not request.get("run"):
            raise ValueError(f"neither run nor quit: {line.strip()}")
        frame, seconds = engine.render()
        peak = peak_memory()
        if "frame" in request:
            np.save(request["frame"], frame)
        reply(seconds=seconds, peak_memory_bytes=peak)


def run(serve: Callable[[TextIO, TextIO], None]) -> int:
    """Let `serve` answer what comes on stdin; the exit code."""
    replies = private_stdout()
    try:
        serve(sys.stdin, replies)
    except Exception as error:  # told to the one who drives this, whatever it is
        print(json.dumps({"error": f"{type(error).__name__}: {error}"}), file=replies, flush=True)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(run(serve))
