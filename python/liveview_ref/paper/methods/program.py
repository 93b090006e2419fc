"""This project's library as it ships, on surface layers from the depth of the photos (src/surface):
not in the paper, and trained on other scenes."""

import tempfile
from errno import ENOENT
from pathlib import Path

import torch
from torch import Tensor

from liveview_ref.data.written_scene import write_photo, write_transforms
from liveview_ref.evaluation.program import TARGET, Program, render
from liveview_ref.paths import MODELS
from liveview_ref.reference.geometry.camera import Camera

from .method import Method, Photos, Rendering


def write_scene(folder: Path, photos: Photos, target: Camera, bounds: tuple[float, float]) -> None:
    """Write a scene from which the library can render the target; bounds: near and far
    in scene units."""
    blank = torch.zeros(3, target.height, target.width)  # in place of the target's photo
    frames = [write_photo(folder, TARGET, blank, target, bounds)]
    for i, (image, camera) in enumerate(zip(photos.images, photos.cameras, strict=True)):
        frames.append(write_photo(folder, f"{i}.png", image, camera, bounds))
    write_transforms(folder, frames)


class Surface(Method):
    """As many surface layers as planes are given, with the shipped network or none; near and far
    are those of the planes. FileNotFoundError if the package is not built."""

    def __init__(self, views: int, network: bool):
        super().__init__()
        model = MODELS / f"liveview_v{views}.onnx"
        for missing in Program(model).missing():
            raise FileNotFoundError(ENOENT, missing, "the package or its model")
        self.options = {"network": model} if network else {"views": views}

    def forward(self, photos: Photos, target: Camera, disparities: Tensor, cover: bool = True) -> Rendering:
        near, far = (1 / float(disparities[i]) for i in (0, -1))
        with tempfile.TemporaryDirectory() as folder:
            write_scene(Path(folder), photos, target, (near, far))
            rgb = render(Path(folder), {"near": near, "far": far}, len(disparities), **self.options)
        return Rendering(rgb, torch.ones(target.height, target.width, dtype=torch.bool))


def surface(views: int) -> Surface:
    """With the network."""
    return Surface(views, network=True)


def surface_without_network(views: int) -> Surface:
    """Without: views weighted by their distance and their agreement."""
    return Surface(views, network=False)
