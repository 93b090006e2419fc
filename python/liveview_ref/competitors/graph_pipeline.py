"""The graph of one_graph.py, run by onnxruntime: warp, network, blend and composite in
one, without torch."""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import onnxruntime

from ..onnx_session import session
from .job import Job, Stopwatch, batches

STATE = ("rgb", "disparity", "transmittance")


class GraphPipeline:
    def __init__(self, job: Job):
        planes = len(job.arrays()["disparities"])
        self.parts = batches(planes, job.batch)
        with tempfile.TemporaryDirectory() as folder:
            # a separate process: the export needs torch, whose memory is not part of the graph's
            module = "liveview_ref.competitors.one_graph"
            build = [sys.executable, "-m", module, job.path, job.network, str(job.batch)]
            done = subprocess.run([*build, folder], stdout=sys.stderr, stderr=subprocess.PIPE, text=True)
            if done.returncode:
                raise ValueError(f"the graph could not be built: {done.stderr.strip().splitlines()[-1]}")
            with np.load(Path(folder) / "inputs.npz") as arrays:
                self.inputs = dict(arrays)
            self.width, self.height = self.inputs.pop("size")
            sizes = {part.stop - part.start for part in self.parts}
            self.sessions = {n: session(Path(folder) / f"planes_{n}.onnx", job.threads) for n in sizes}
        self.title = f"ONNX Runtime {onnxruntime.__version__} (Python), one graph"

    def render(self) -> tuple[np.ndarray, dict[str, float]]:
        clock = Stopwatch()
        with clock("total"):
            fed = dict(self.inputs)
            for part in self.parts:
                for name in ("homographies", "disparities", "background"):
                    fed[name] = self.inputs[name][part]
                found = self.sessions[part.stop - part.start].run(None, fed)
                fed |= dict(zip(STATE, found, strict=True))
            frame = np.ascontiguousarray(fed["rgb"][:, : self.height, : self.width].transpose(1, 2, 0))
        return frame, clock.seconds
