"""The whole pipeline as one ONNX graph.

    python -m liveview_ref.competitors.one_graph JOB.npz WEIGHTS.pt|MODEL.onnx BATCH FOLDER

Built for one job, with fixed shapes. A run takes a batch of planes and the sums over the previous
planes, and returns the sums including these planes, front to back, so that memory does not grow
with the number of planes. Writes to FOLDER `planes_N.onnx` for each size of batch that the job
needs, and `inputs.npz`, so that running them (graph_pipeline.py) needs only onnxruntime and numpy,
not the memory of torch and the export.
"""

import sys
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..checkpoint import load_network
from ..export import export_traced
from ..reference.layers import accumulate, empty, outside_masked
from ..reference.liveview import PlaneSweep, UNet, blend, grid_from_pixels, padded_size, view_distances, with_coverage
from ..rig_arrays import Arrays, cameras_of, images_of
from .job import batches

INPUTS = ("images", "homographies", "distances", "disparities", "background", "rgb", "disparity", "transmittance")
OUTPUTS = ("rgb_out", "disparity_out", "transmittance_out")


class Planes(nn.Module):
    """images [V, 4, h, w] (photo and ones; zeros where a photo is smaller than the largest),
    homographies [n, V, 3, 3] (normalised source coordinates from target pixels), distances [V],
    disparities [n], background [n] bool, and the sums so far: rgb [3, H8, W8], disparity and
    transmittance [H8, W8] -> the sums with these planes."""

    def __init__(self, network: UNet, size: tuple[int, int]):
        super().__init__()
        self.network, self.size = network, size
        x, y = torch.arange(size[1]) + 0.5, torch.arange(size[0]) + 0.5
        pixels = torch.stack([*torch.meshgrid(x, y, indexing="xy"), torch.ones(size)]).flatten(1)
        self.register_buffer("pixels", pixels)  # [3, H8 W8]

    def forward(self, images, homographies, distances, disparities, background, rgb, disparity, transmittance):
        height, width = self.size
        views, planes = len(images), len(homographies)
        points = (homographies.transpose(0, 1) @ self.pixels).unflatten(3, self.size)  # [V, n, 3, H8, W8]
        w = points[:, :, 2]
        grid = outside_masked(torch.stack([points[:, :, 0] / w, points[:, :, 1] / w], -1), w)
        grid = grid.reshape(views, planes * height, width, 2)  # a view's planes below each other
        warped = F.grid_sample(images, grid, padding_mode="zeros", align_corners=False)
        warped = warped.reshape(views, 4, planes, height, width).permute(2, 0, 1, 3, 4)
        colour, coverage = warped[:, :, :3], warped[:, :, 3]
        alpha, rgb_of_planes = blend(self.network(colour.flatten(1, 2)), colour, coverage, distances)
        state = rgb, disparity, transmittance
        return accumulate(state, alpha, rgb_of_planes, coverage, disparities, background)


def inputs_of(data: Arrays) -> dict[str, Tensor]:
    """INPUTS for all planes of a job, with the sums before the first plane."""
    cameras, target = cameras_of(data)
    photos = [with_coverage(image) for image in images_of(data, torch.float32)]
    height, width = (max(side) for side in zip(*(photo.shape[1:] for photo in photos), strict=True))
    images = [F.pad(photo, (0, width - photo.shape[2], 0, height - photo.shape[1])) for photo in photos]
    into_grid = grid_from_pixels(width, height)
    sweeps = [PlaneSweep.of(camera, target) for camera in cameras]
    rows = [[into_grid @ sweep.source_from_target(float(d)) for sweep in sweeps] for d in data["disparities"]]
    planes = len(rows)
    rgb, disparity, transmittance = empty(padded_size(target.height, target.width))
    values = (
        torch.stack(images),
        torch.stack([torch.stack(row) for row in rows]).float(),
        view_distances(cameras, target).float(),
        torch.from_numpy(data["disparities"]).float(),
        torch.arange(planes) == planes - 1,
        rgb,
        disparity,
        transmittance,
    )
    return dict(zip(INPUTS, values, strict=True))


def first_planes(inputs: dict[str, Tensor], count: int) -> dict[str, Tensor]:
    """INPUTS of the first batch of `count` planes."""
    of_planes = ("homographies", "disparities", "background")
    return {name: value[:count] if name in of_planes else value for name, value in inputs.items()}


@torch.inference_mode()
def build(data: Arrays, network: UNet, batch: int, folder: Path) -> None:
    """Write the graphs and inputs of a job to `folder`."""
    inputs = inputs_of(data)
    planes = Planes(network, tuple(inputs["transmittance"].shape)).eval()
    for part in {part.stop - part.start for part in batches(len(data["disparities"]), batch)}:
        graph = folder / f"planes_{part}.onnx"
        export_traced(
            planes, tuple(first_planes(inputs, part).values()), graph, input_names=INPUTS, output_names=OUTPUTS
        )
    size = data["target.size"]
    np.savez(folder / "inputs.npz", size=size, **{name: value.numpy() for name, value in inputs.items()})


def main() -> None:
    job, weights, batch, folder = sys.argv[1:]
    with np.load(job) as arrays:
        data = dict(arrays)
    build(data, load_network(Path(weights)), int(batch), Path(folder))


if __name__ == "__main__":
    main()
