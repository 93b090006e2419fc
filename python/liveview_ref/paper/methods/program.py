"""This project's program as it ships, on layers along the surface that the photos' own depth gives (src/mvs): not in
the paper, and trained on other scenes."""

import tempfile
from errno import ENOENT
from pathlib import Path

import torch
from torch import Tensor

from ...data.written_scene import write_photo, write_transforms
from ...evaluation.program import TARGET, Program
from ...reference.camera import Camera
from ..method import Method, Photos, Rendering

ROOT = Path(__file__).parents[4]
BINARY = ROOT / "target" / "release" / "liveview"


class Surface(Method):
    """As many layers along the surface as there are planes, with the shipped network or none; near and far are those of
    the planes. FileNotFoundError where the program is not built."""

    def __init__(self, views: int, network: bool):
        super().__init__()
        if not BINARY.is_file():
            raise FileNotFoundError(ENOENT, "not built", str(BINARY))
        self.program = Program(BINARY, ROOT / "models" / f"liveview_v{views}.onnx", torch.get_num_threads())
        self.options = ["--model", self.program.model] if network else ["--network", "none", "--views", views]

    def forward(self, photos: Photos, target: Camera, disparities: Tensor, cover: bool = True) -> Rendering:
        near, far = (1 / float(disparities[i]) for i in (0, -1))
        with tempfile.TemporaryDirectory() as folder:
            blank = torch.zeros(3, target.height, target.width)  # where the target's photo is expected
            frames = [write_photo(Path(folder), TARGET, blank, target, (near, far))]
            for i, (image, camera) in enumerate(zip(photos.images, photos.cameras, strict=True)):
                frames.append(write_photo(Path(folder), f"{i}.png", image, camera, (near, far)))
            write_transforms(Path(folder), frames)
            rgb = self.program.render(Path(folder), {"near": near, "far": far}, len(disparities), self.options)
        return Rendering(rgb, torch.ones(target.height, target.width, dtype=torch.bool))


def surface(views: int) -> Surface:
    """With the network."""
    return Surface(views, network=True)


def surface_without_network(views: int) -> Surface:
    """Views weighed by distance alone, layers in equal shares."""
    return Surface(views, network=False)
