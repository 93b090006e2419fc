"""This project's library as it ships, on surface layers from the depth of the photos:
not in the paper, and trained on other scenes."""

from errno import ENOENT

import torch
from torch import Tensor

from liveview_ref.evaluation.program import missing, rendered
from liveview_ref.paths import MODELS
from liveview_ref.reference.liveview import Camera

from .method import Method, Photos, Rendering


class Surface(Method):
    """As many surface layers as planes are given, with the shipped network or none; near and far
    are those of the planes. FileNotFoundError if the Python package is not built."""

    def __init__(self, views: int, network: bool):
        super().__init__()
        model = MODELS / f"liveview_v{views}.onnx"
        if lacking := missing(model):
            raise FileNotFoundError(ENOENT, "not built yet", ", ".join(lacking))
        self.options = {"views": views, "network": model if network else None}

    def forward(self, photos: Photos, target: Camera, disparities: Tensor, cover: bool = True) -> Rendering:
        near, far = (1 / float(disparities[i]) for i in (0, -1))
        options = self.options | {"near": near, "far": far, "layers": f"surface:{len(disparities)}"}
        rgb = rendered(photos.images, photos.cameras, target, **options)
        return Rendering(rgb, torch.ones(target.height, target.width, dtype=torch.bool))


def surface(views: int) -> Surface:
    """With the network."""
    return Surface(views, network=True)


def surface_without_network(views: int) -> Surface:
    """Without: views weighted by their distance and their agreement."""
    return Surface(views, network=False)
