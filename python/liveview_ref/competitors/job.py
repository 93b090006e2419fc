"""The job that the competitors render, and their timing.

Without torch and onnxruntime, whose memory would count in processes that do not need them.

All warp, run the network, blend and composite `batch` planes at a time, so that memory does not
grow with their number. Preparations that do not depend on the target (photos as tensors, network)
are not timed.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

NAMES = ("reference", "torch", "torch channels_last", "onnxruntime + kornia")


@dataclass(frozen=True)
class Job:
    """What to render, by which competitor (one of NAMES). `path`: arrays as in rig_arrays.py, and
    `disparities` of planes. `weights` None: those of the model."""

    path: Path
    model: Path
    weights: Path | None
    competitor: str
    threads: int
    batch: int

    @property
    def network(self) -> Path:
        """The file of the network."""
        return self.weights or self.model

    @classmethod
    def of(cls, message: dict) -> "Job":
        """The job in a request to worker.py."""
        weights = message.get("weights")
        job = cls(
            Path(message["job"]),
            Path(message["model"]),
            Path(weights) if weights else None,
            message["engine"],
            int(message.get("threads", 2)),
            int(message.get("batch", 1)),
        )
        if job.competitor not in NAMES:
            raise ValueError(f"no competitor {job.competitor!r}; expected one of {', '.join(NAMES)}")
        if job.threads < 1 or job.batch < 1:
            raise ValueError(f"threads {job.threads}, batch {job.batch}: expected at least 1")
        return job

    def arrays(self) -> dict[str, np.ndarray]:
        with np.load(self.path) as arrays:
            data = dict(arrays)
        if "disparities" not in data or not len(data["disparities"]):
            raise ValueError(f"{self.path}: disparities: expected at least one plane")
        return data


class Competitor(Protocol):
    """One implementation, ready to render its job; `title` names it with its version."""

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
    """Planes near -> far in parts of `batch`; the last one may be smaller."""
    return [slice(first, min(first + batch, planes)) for first in range(0, planes, batch)]
