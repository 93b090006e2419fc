"""The job that the competitors render, the pipeline in PyTorch, optimised for speed, and the
reference itself.

All warp, run the network, blend and composite `batch` planes at a time, so that memory does not
grow with their number. Preparations that do not depend on the target (photos as tensors, network)
are not timed. TorchPipeline is faster than the reference (liveview.py) with the same result:
BatchNorm is folded; only the sums of the composite are kept; a plane needs no disparity map, so its
coordinates are three multiply-adds and a division on the rays of the target; and points behind a
camera or with huge coordinates are masked only if the corners of the target show that there may be
any (w is affine over the target, so its extremes are at the corners).
"""

import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..checkpoint import load_network
from ..reference.layers import OUTSIDE, accumulate, empty, outside_masked
from ..reference.liveview import (
    Camera,
    Network,
    PlaneSweep,
    blend,
    grid_from_pixels,
    padded_size,
    render,
    view_distances,
    with_coverage,
)
from ..rig_arrays import Arrays, cameras_of, images_of

NAMES = ("reference", "torch", "torch channels_last", "onnxruntime + kornia")


@dataclass(frozen=True)
class Job:
    """What to render, by which competitor (one of NAMES). `data`: arrays as in rig_arrays.py, and
    `disparities` of planes. `weights` None: those of the model."""

    data: Arrays
    model: Path
    weights: Path | None
    competitor: str
    threads: int
    batch: int

    @property
    def network(self) -> Path:
        """The file of the network."""
        return self.weights or self.model


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


PlaneWarp = Callable[[Tensor], Tensor]  # disparities [n] -> colour and coverage of a view [n, 4, H8, W8]
LEAST_W = 1e-3  # of the largest w of a target; if its least w is smaller, points behind the camera are masked


def in_front(w: Tensor) -> Tensor:
    """Whether a plane lies well in front of the source, by w [n, h, w] at the target's corners ->
    [n] bool."""
    corners = w[:, [0, 0, -1, -1], [0, -1, 0, -1]]
    return corners.amin(1) > LEAST_W * corners.amax(1)


def grid_warp(rgbc: Tensor, source: Camera, target: Camera, size: tuple[int, int]) -> PlaneWarp:
    """Planes by grid_sample. rgbc [4, Hs, Ws]: photo and ones; size: of the padded
    target (height, width)."""
    height, width = size
    into_grid = grid_from_pixels(source.width, source.height)
    homography, epipole = ((into_grid @ term).float() for term in PlaneSweep.of(source, target))
    x, y = torch.arange(width) + 0.5, torch.arange(height)[:, None] + 0.5
    rays = [row[0] * x + (row[1] * y + row[2]) for row in homography]

    def warp(disparities: Tensor) -> Tensor:
        u, v, w = (ray + shift * disparities[:, None, None] for ray, shift in zip(rays, epipole, strict=True))
        grid = torch.stack([u / w, v / w], -1)
        if not bool(in_front(w).all()):
            grid = outside_masked(grid, w)
        stacked = grid.reshape(1, -1, width, 2)  # one image for all planes, without a copy per plane
        warped = F.grid_sample(rgbc[None], stacked, padding_mode="zeros", align_corners=False)
        return warped.reshape(4, -1, height, width).transpose(0, 1)

    return warp


def kornia_warp(rgbc: Tensor, source: Camera, target: Camera, size: tuple[int, int]) -> PlaneWarp:
    """Planes by kornia's homography_warp; arguments as for grid_warp.

    kornia samples points behind the camera as well, mirrored; they are masked.
    """
    from kornia.geometry.transform import homography_warp

    height, width = size
    into_grid, target_grid = grid_from_pixels(source.width, source.height), grid_from_pixels(width, height)
    x, y = torch.arange(width) + 0.5, torch.arange(height)[:, None] + 0.5
    sweep = PlaneSweep.of(source, target)

    def warp(disparities: Tensor) -> Tensor:
        homographies = into_grid @ torch.stack([sweep.source_from_target(float(d)) for d in disparities])
        images = rgbc.expand(len(disparities), -1, -1, -1)
        normal = (homographies @ torch.linalg.inv(target_grid)).float()
        warped = homography_warp(images, normal, size, align_corners=False)
        for plane, homography in zip(warped, homographies.float(), strict=True):
            u, v, w = (row[0] * x + (row[1] * y + row[2]) for row in homography)
            if not bool(in_front(w[None])):
                outside = outside_masked(torch.stack([u / w, v / w], -1), w)[..., 0] == OUTSIDE
                plane.masked_fill_(outside, 0.0)
        return warped

    return warp


class TorchPipeline:
    """Warp by grid_warp or kornia_warp, any network, blend and composite in torch."""

    def __init__(self, job: Job, title: str, warp: Callable[..., PlaneWarp], network: Network):
        self.title, self.warp, self.network = title, warp, network
        self.cameras, self.target = cameras_of(job.data)
        self.images = [with_coverage(image) for image in images_of(job.data, torch.float32)]
        self.disparities = torch.from_numpy(job.data["disparities"])
        self.batches = batches(len(self.disparities), job.batch)

    @torch.inference_mode()
    def render(self) -> tuple[np.ndarray, dict[str, float]]:
        clock = Stopwatch()
        size = padded_size(self.target.height, self.target.width)
        with clock("warp"):
            rig = zip(self.images, self.cameras, strict=True)
            warps = [self.warp(image, camera, self.target, size) for image, camera in rig]
            distances = view_distances(self.cameras, self.target)
        state = empty(size)
        for part in self.batches:
            disparities = self.disparities[part].float()
            with clock("warp"):
                warped = [warp(disparities) for warp in warps]
                colour = torch.stack([rgbc[:, :3] for rgbc in warped], 1)
                coverage = torch.stack([rgbc[:, 3] for rgbc in warped], 1)
            with clock("network"):
                logits = self.network(colour.flatten(1, 2))
            with clock("composite"):
                alpha, rgb = blend(logits, colour, coverage, distances)
                background = torch.arange(part.start, part.stop) == len(self.disparities) - 1
                state = accumulate(state, alpha, rgb, coverage, disparities, background)
        with clock("composite"):
            frame = state[0][:, : self.target.height, : self.target.width].permute(1, 2, 0).contiguous()
        return frame.numpy(), clock.seconds


class ReferencePipeline:
    """liveview.py unchanged, in float32, a plane at a time; it keeps every stage."""

    title = f"PyTorch {torch.__version__} reference"

    def __init__(self, job: Job):
        self.network = load_network(job.network)
        self.cameras, self.target = cameras_of(job.data)
        self.images = images_of(job.data, torch.float32)
        self.disparities = torch.from_numpy(job.data["disparities"])

    @torch.inference_mode()
    def render(self) -> tuple[np.ndarray, dict[str, float]]:
        clock = Stopwatch()
        with clock("total"):
            frame, _ = render(self.network, self.images, self.cameras, self.target, self.disparities)
        return frame.rgb.permute(1, 2, 0).contiguous().numpy(), clock.seconds


def start(job: Job) -> TorchPipeline | ReferencePipeline:
    torch.set_num_threads(job.threads)
    if job.competitor == "reference":
        return ReferencePipeline(job)
    if job.competitor == "onnxruntime + kornia":
        import kornia
        import onnxruntime

        from ..onnx_session import logits, session

        model = session(job.model, job.threads)
        title = f"ONNX Runtime {onnxruntime.__version__} (Python), kornia {kornia.__version__}"
        return TorchPipeline(job, title, kornia_warp, lambda hwv: torch.from_numpy(logits(model, hwv.numpy())))
    net = load_network(job.network)
    title = f"PyTorch {torch.__version__} eager"
    if job.competitor == "torch":
        return TorchPipeline(job, title, grid_warp, net)
    net = net.to(memory_format=torch.channels_last)
    network = lambda hwv: net(hwv.contiguous(memory_format=torch.channels_last))  # noqa: E731
    return TorchPipeline(job, f"{title}, channels_last", grid_warp, network)


def peak_memory() -> int:
    """Largest resident memory of this process so far, bytes (VmHWM)."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024


def measured(job: Job, repetitions: int) -> dict:
    """The row of a competitor: of `repetitions` renders, after one to warm up.

    Here, since a process that is started for it finds no functions of a package's `__main__`.
    """
    competitor = start(job)
    runs = [competitor.render()[1] for _ in range(repetitions + 1)][1:]
    totals = sorted(sum(seconds.values()) for seconds in runs)
    seconds = {"median": statistics.median(totals), "min": totals[0], "max": totals[-1], "all": totals}
    row = {"layers": f"planes:{len(job.data['disparities'])}", "engine": competitor.title, "reference": True}
    return row | {"seconds": seconds, "peak_memory_bytes": peak_memory()}
