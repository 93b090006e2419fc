"""The engines that the Rust runtime is timed against: what they have in common. No torch here: it counts as memory.

All render the same job: warp, network, blend and composite, `batch` planes at a time, so that memory does not grow with
their number. What does not depend on the target (photos as tensors, network) is made before the clock starts.
"""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

NAMES = ("reference", "torch", "torch channels_last", "onnxruntime + kornia", "one graph")


@dataclass(frozen=True)
class Job:
    """What to render (`path`, arrays as stages.py names them) and with what. `weights` None: those of the model."""

    path: Path
    model: Path
    weights: Path | None
    engine: str
    threads: int
    batch: int

    @classmethod
    def of(cls, message: dict) -> "Job":
        weights = message.get("weights")
        job = cls(
            Path(message["job"]),
            Path(message["model"]),
            Path(weights) if weights else None,
            message["engine"],
            int(message.get("threads", 2)),
            int(message.get("batch", 1)),
        )
        if job.engine not in NAMES:
            raise ValueError(f"no engine {job.engine!r}: there are {', '.join(NAMES)}")
        if job.threads < 1 or job.batch < 1:
            raise ValueError(f"threads ({job.threads}) and batch ({job.batch}) must be at least 1")
        return job

    def arrays(self) -> dict[str, np.ndarray]:
        with np.load(self.path) as arrays:
            data = dict(arrays)
        if "disparities" not in data or not len(data["disparities"]):
            raise ValueError(f"{self.path}: no planes (disparities)")
        return data


class Engine(Protocol):
    title: str

    def render(self) -> tuple[np.ndarray, dict[str, float]]:
        """The picture, float32 [h, w, 3], and the seconds of each stage, or their total."""


class Stopwatch:
    """Seconds by stage, summed over the batches of a render."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        started = time.perf_counter()
        yield
        self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - started


def batches(planes: int, batch: int) -> list[slice]:
    """Planes near -> far in parts of `batch`, the last one perhaps smaller."""
    return [slice(first, min(first + batch, planes)) for first in range(0, planes, batch)]


def session(model: Path | bytes, threads: int):
    """onnxruntime on these many threads, which sleep whenever they have nothing to do."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def start(job: Job) -> Engine:
    """The engine of this job. Threads are told to sleep when idle before any library that has some is loaded: other
    workers are timed in the meantime."""
    os.environ |= {"OMP_NUM_THREADS": str(job.threads), "OMP_WAIT_POLICY": "passive"}
    if job.engine == "one graph":
        from .engine_graph import GraphEngine

        return GraphEngine(job)
    from . import engine_torch

    return engine_torch.start(job)
