"""The pipeline in plain PyTorch, written for speed: an opponent for the Rust runtime, not the oracle (render.py is).

Where it departs from render.py it is to be faster, with the same result: BatchNorm is folded; nothing but the sums of
the composite is kept; a plane needs no disparity map, so that its coordinates are three multiply-adds and a division on
the rays of the target; and the mask for what lies behind a camera, or is huge, is left out where the corners of
the target show that there is none (w is affine over the target, so its extremes lie there).
"""

from collections.abc import Callable

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from . import stages
from .blend import blend
from .camera import Camera
from .composite import accumulate, empty
from .engines import Job, Stopwatch, batches, session
from .layers import padded_size
from .parity import load_network
from .render import planes_over, render, view_distances
from .sweep import plane_homography, sweep_terms
from .unet import UNet, fold_batchnorm
from .warp import OUTSIDE, grid_from_pixels, outside_masked, with_coverage

Network = Callable[[Tensor], Tensor]  # hwv [n, 3V, H8, W8] -> logits [n, V, H8, W8]
Sweep = Callable[[Tensor], Tensor]  # disparities [n] -> colour and coverage of a view [n, 4, H8, W8]
FRONT = 1e-3  # of the largest w: a smaller one somewhere on the target calls for the mask


def folded_network(job_weights, job_model) -> UNet:
    """The network in float32, BatchNorm folded, of a training's weights or else of an exported model."""
    if job_weights is None:
        return load_network(job_model)
    state = torch.load(job_weights, weights_only=True, map_location="cpu")
    net = UNet(state["views"]).eval()
    net.load_state_dict(state["average"])
    return fold_batchnorm(net)


def in_front(w: Tensor) -> Tensor:
    """Whether a plane lies well in front of the source, from w at the target's corners [n, h, w] -> [n] bool."""
    corners = w[:, [0, 0, -1, -1], [0, -1, 0, -1]]
    return corners.amin(1) > FRONT * corners.amax(1)


def grid_sweep(rgbc: Tensor, source: Camera, target: Camera, size: tuple[int, int]) -> Sweep:
    """Planes by grid_sample. rgbc [4, Hs, Ws]: photo and ones; size: of the padded target (height, width)."""
    height, width = size
    into_grid = grid_from_pixels(source.width, source.height)
    homography, e = ((into_grid @ term).float() for term in sweep_terms(source, target))
    x, y = torch.arange(width) + 0.5, torch.arange(height)[:, None] + 0.5
    rays = [row[0] * x + (row[1] * y + row[2]) for row in homography]

    def sweep(disparities: Tensor) -> Tensor:
        u, v, w = (ray + shift * disparities[:, None, None] for ray, shift in zip(rays, e, strict=True))
        grid = torch.stack([u / w, v / w], -1)
        if not bool(in_front(w).all()):
            grid = outside_masked(grid, w)
        stacked = grid.reshape(1, -1, width, 2)  # one image, all planes: no copy of the image per plane
        warped = F.grid_sample(rgbc[None], stacked, padding_mode="zeros", align_corners=False)
        return warped.reshape(4, -1, height, width).transpose(0, 1)

    return sweep


def kornia_sweep(rgbc: Tensor, source: Camera, target: Camera, size: tuple[int, int]) -> Sweep:
    """Planes by kornia's homography_warp, as its users write it; arguments as for grid_sweep.

    kornia shows what lies behind the camera mirrored, hence the mask on its result.
    """
    from kornia.geometry.transform import homography_warp

    height, width = size
    into_grid, target_grid = grid_from_pixels(source.width, source.height), grid_from_pixels(width, height)
    x, y = torch.arange(width) + 0.5, torch.arange(height)[:, None] + 0.5

    def sweep(disparities: Tensor) -> Tensor:
        homographies = into_grid @ torch.stack([plane_homography(source, target, float(d)) for d in disparities])
        images = rgbc.expand(len(disparities), -1, -1, -1)
        normal = (homographies @ torch.linalg.inv(target_grid)).float()
        warped = homography_warp(images, normal, size, align_corners=False)
        for plane, homography in zip(warped, homographies.float(), strict=True):
            u, v, w = (row[0] * x + (row[1] * y + row[2]) for row in homography)
            if not bool(in_front(w[None])):
                outside = outside_masked(torch.stack([u / w, v / w], -1), w)[..., 0] == OUTSIDE
                plane.masked_fill_(outside, 0.0)
        return warped

    return sweep


class TorchEngine:
    """Warp by either sweep, any network, blend and composite in torch."""

    def __init__(self, job: Job, title: str, sweep: Callable[..., Sweep], network: Network):
        data = job.arrays()
        self.title, self.sweep, self.network = title, sweep, network
        self.cameras, self.target = stages.cameras_of(data)
        self.images = [with_coverage(image) for image in stages.images_of(data, torch.float32)]
        self.disparities = torch.from_numpy(data["disparities"])
        self.batches = batches(len(self.disparities), job.batch)

    @torch.inference_mode()
    def render(self) -> tuple[np.ndarray, dict[str, float]]:
        clock = Stopwatch()
        size = padded_size(self.target.height, self.target.width)
        with clock("warp"):
            rig = zip(self.images, self.cameras, strict=True)
            sweeps = [self.sweep(image, camera, self.target, size) for image, camera in rig]
            distances = view_distances(self.cameras, self.target)
        state = empty(size)
        for part in self.batches:
            disparities = self.disparities[part].float()
            with clock("warp"):
                warped = [sweep(disparities) for sweep in sweeps]
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


class ReferenceEngine:
    """render.py as it stands, in float32 and with its own batches: written to be read, every stage kept."""

    title = f"PyTorch {torch.__version__} reference"

    def __init__(self, job: Job):
        data = job.arrays()
        self.network = folded_network(job.weights, job.model)
        self.cameras, self.target = stages.cameras_of(data)
        self.images = stages.images_of(data, torch.float32)
        self.maps = planes_over(self.target, torch.from_numpy(data["disparities"]), torch.float32)

    @torch.inference_mode()
    def render(self) -> tuple[np.ndarray, dict[str, float]]:
        clock = Stopwatch()
        with clock("total"):
            frame, _ = render(self.network, self.images, self.cameras, self.target, self.maps)
        return frame.rgb.permute(1, 2, 0).contiguous().numpy(), clock.seconds


def start(job: Job) -> TorchEngine | ReferenceEngine:
    torch.set_num_threads(job.threads)
    if job.engine == "reference":
        return ReferenceEngine(job)
    if job.engine == "onnxruntime + kornia":
        import kornia
        import onnxruntime

        model = session(job.model, job.threads)
        title = f"ONNX Runtime {onnxruntime.__version__} (Python), kornia {kornia.__version__}"
        network = lambda hwv: torch.from_numpy(model.run(["logits"], {"hwv": hwv.numpy()})[0])  # noqa: E731
        return TorchEngine(job, title, kornia_sweep, network)
    net = folded_network(job.weights, job.model)
    title = f"PyTorch {torch.__version__} eager"
    if job.engine == "torch":
        return TorchEngine(job, title, grid_sweep, net)
    net = net.to(memory_format=torch.channels_last)
    network = lambda hwv: net(hwv.contiguous(memory_format=torch.channels_last))  # noqa: E731
    return TorchEngine(job, f"{title}, channels_last", grid_sweep, network)
