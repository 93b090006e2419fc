"""One competitor in its own process, driven line by line.

    python -m liveview_ref.competitors.worker

`liveview sweep --reference` starts a worker for each competitor, so that the peak memory of each
can be measured, and runs them in turns, so that other load on the machine affects all alike. One
JSON object per line, in and out, on stdin and stdout; notes go to stderr. Relative paths are
relative to the worker's working directory.

    in   {"job": FILE.npz, "model": FILE.onnx, "weights": FILE.pt or null, "engine": NAME,
          "threads": 2, "batch": 1}
    out  {"ready": true, "engine": "the competitor with its version"}
    in   {"run": true, "frame": FILE.npy}
    out  {"seconds": {"warp": s, "network": s, "composite": s} or {"total": s},
          "peak_memory_bytes": since the start}
    in   {"quit": true}, or the end of input
    out  {"error": "..."} after a failure, and exit code 2

`frame`, float32 [h, w, 3], is optional; writing it is not timed. The job's arrays are those of
rig_arrays.py, and `disparities` of planes. NAME is one of pipelines.NAMES.
"""

import json
import os
import sys
from pathlib import Path
from typing import TextIO

import numpy as np

from ..json_lines import run


def peak_memory() -> int:
    """Largest resident memory of this process so far, bytes (VmHWM)."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024


def serve(requests: TextIO, replies: TextIO) -> None:
    """Answer requests until {"quit": true} or the end of input."""

    def reply(**message) -> None:
        print(json.dumps(message), file=replies, flush=True)

    line = requests.readline()
    if not line:
        return
    message = json.loads(line)
    # Idle threads must sleep while other workers are timed; set before torch is loaded.
    os.environ |= {"OMP_NUM_THREADS": str(message.get("threads", 2)), "OMP_WAIT_POLICY": "passive"}
    from . import pipelines

    competitor = pipelines.start(pipelines.Job.of(message))
    reply(ready=True, engine=competitor.title)
    for line in requests:
        request = json.loads(line)
        if request.get("quit"):
            return
        if not request.get("run"):
            raise ValueError(f"{line.strip()}: expected run or quit")
        frame, seconds = competitor.render()
        peak = peak_memory()
        if "frame" in request:
            np.save(request["frame"], frame)
        reply(seconds=seconds, peak_memory_bytes=peak)


if __name__ == "__main__":
    sys.exit(run(serve))
