"""Warp, blend and composite as ONNX graphs, in float32, run by onnxruntime."""

import functools
import io

import numpy as np
import onnxruntime
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..export import export_traced
from ..onnx_session import session
from ..reference.composite import accumulate, empty
from ..reference.geometry.camera import Camera
from ..reference.geometry.plane_sweep import PlaneSweep
from ..reference.render import blend as reference_blend
from ..reference.warp import grid_from_pixels, outside_masked, with_coverage


class Warp(nn.Module):
    """image [1, 4, h, w], homography [3, 3] (normalised source coordinates from target pixels),
    pixels [3, P] -> [1, 4, P, 1]."""

    def forward(self, image, homography, pixels):
        points = homography @ pixels
        grid = outside_masked((points[:2] / points[2]).T[None, :, None], points[2][None, :, None])
        return F.grid_sample(image, grid, padding_mode="zeros", align_corners=False)


class Blend(nn.Module):
    def forward(self, *inputs):
        return reference_blend.blend(*inputs)


class Composite(nn.Module):
    """Composite one more plane behind the previous ones."""

    def forward(self, rgb, disparity, transmittance, *plane):
        return accumulate((rgb, disparity, transmittance), *plane)


def graph_of(module: nn.Module, inputs: tuple[Tensor, ...], dynamic: dict) -> onnxruntime.InferenceSession:
    """A session of the module, traced with these inputs, named input0, input1, ...; `dynamic` axes
    as in torch.onnx.export."""
    file = io.BytesIO()
    export_traced(module, inputs, file, input_names=[f"input{i}" for i in range(len(inputs))], dynamic_axes=dynamic)
    return session(file.getvalue(), 1)


def run(graph: onnxruntime.InferenceSession, inputs: tuple[Tensor, ...]) -> list[np.ndarray]:
    wanted = {node.name for node in graph.get_inputs()}  # constant folding may have dropped some
    feed = {f"input{i}": value.numpy() for i, value in enumerate(inputs) if f"input{i}" in wanted}
    return graph.run(None, feed)


@functools.cache
def warp_graph() -> onnxruntime.InferenceSession:
    inputs = torch.rand(1, 4, 8, 9), torch.eye(3), torch.rand(3, 5)
    return graph_of(Warp(), inputs, {"input0": {2: "h", 3: "w"}, "input2": {1: "p"}})


def warp(image: Tensor, source: Camera, target: Camera, disparity: float) -> tuple[np.ndarray, np.ndarray]:
    """Colour [3, P] and coverage [P] of a plane."""
    sweep = PlaneSweep.of(source, target)
    homography = grid_from_pixels(image.shape[2], image.shape[1]) @ sweep.source_from_target(disparity)
    x, y = torch.arange(target.width) + 0.5, torch.arange(target.height) + 0.5
    pixels = torch.stack([*torch.meshgrid(x, y, indexing="xy"), torch.ones(target.height, target.width)]).flatten(1)
    (samples,) = run(warp_graph(), (with_coverage(image)[None], homography.float(), pixels))
    return samples[0, :3, :, 0], samples[0, 3, :, 0]


def blend_inputs(data: dict[str, np.ndarray]) -> tuple[Tensor, ...]:
    """The arguments of blend.blend, with the pixels in one row."""
    logits, colour, coverage = (torch.from_numpy(data[x])[None, :, None] for x in ("logits", "colour", "coverage"))
    return logits, colour.unflatten(1, (-1, 3)), coverage, torch.from_numpy(data["distances"])


@functools.cache
def blend_graph(views: int, coincident: bool) -> onnxruntime.InferenceSession:
    distances = torch.arange(views) + (0.0 if coincident else 1.0)
    inputs = torch.rand(1, views, 1, 7), torch.rand(1, views, 3, 1, 7), torch.rand(1, views, 1, 7), distances
    return graph_of(Blend(), inputs, {"input0": {3: "p"}, "input1": {4: "p"}, "input2": {3: "p"}})


def blend(inputs: tuple[Tensor, ...]) -> list[np.ndarray]:
    """Alpha and RGB."""
    *samples, distances = inputs
    graph = blend_graph(len(distances), bool((distances == 0).any()))
    return run(graph, (*samples, distances.float()))


@functools.cache
def composite_graph(pixels: int) -> onnxruntime.InferenceSession:
    size = 1, pixels
    plane = torch.rand(1, *size), torch.rand(1, 3, *size), torch.rand(1, 1, *size), torch.rand(1), torch.tensor([True])
    return graph_of(Composite(), (*empty(size), *plane), {})


def composite(alpha: Tensor, rgb: Tensor, covered: Tensor, maps: Tensor) -> tuple[Tensor, ...]:
    """RGB, disparity and transmittance, plane by plane. Every plane has a constant disparity."""
    state, last = empty(alpha.shape[1:]), len(alpha) - 1
    for k in range(last + 1):
        background = torch.tensor([k == last])
        plane = alpha[k : k + 1], rgb[k : k + 1], covered[None, None].float(), maps[k, 0, :1], background
        state = tuple(torch.from_numpy(x) for x in run(composite_graph(alpha.shape[-1]), (*state, *plane)))
    return state
