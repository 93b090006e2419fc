"""LiveView (Ghosh et al., CVPR 2021): the U-Net of its table "Network architecture", one plane
at a time.

Photos are in the rig's order, as in the paper; `liveview render` takes them nearest first."""

import math

import torch
from torch import Tensor

from liveview_ref.checkpoint import load_state
from liveview_ref.paths import MODELS
from liveview_ref.reference.competing import composite_competing
from liveview_ref.reference.liveview import Camera, UNet, blend
from liveview_ref.weights import contiguous_gradients, start_from_agreement

from .method import Photos, Predictor, Rendering
from .mpi import Mpi, padded, volume_at

INITIAL_PLANES = 64  # number of planes for which alpha is initialised
BATCH = 8  # planes per pass of the network outside training, so that memory does not grow with their number


class PlaneByPlane(Predictor):
    """The dynamic multiplane image: alpha and the photos' weights of a plane depend on
    that plane alone."""

    def __init__(self, views: int, by_distance: bool = True):
        super().__init__()
        self.net, self.by_distance = contiguous_gradients(UNet(views)), by_distance
        # alpha starts at 1 / planes, as in the other methods
        torch.nn.init.constant_(self.net.conv9.bias[:1], -math.log(INITIAL_PLANES - 1))
        self.net.to(memory_format=torch.channels_last)

    def logits(self, volume: Tensor) -> Tensor:
        """volume [D, V, 3, H, W] -> [D, V, H, W]"""
        planes = volume.flatten(1, 2).contiguous(memory_format=torch.channels_last)
        if self.training:
            return self.net(planes).float()
        return torch.cat([self.net(part).float() for part in planes.split(BATCH)])

    def forward(self, volume: Tensor, coverage: Tensor, distances: Tensor) -> tuple[Tensor, Tensor]:
        return self.batch([(volume, coverage, distances)])[0]

    def each(self, volumes: list[tuple[Tensor, Tensor, Tensor]]) -> list[Tensor]:
        """The logits of each volume, in one pass over all."""
        logits = self.logits(torch.cat([volume for volume, _, _ in volumes]))
        return [own.contiguous() for own in logits.split([len(volume) for volume, _, _ in volumes])]

    def batch(self, volumes: list[tuple[Tensor, Tensor, Tensor]]) -> list[tuple[Tensor, Tensor]]:
        pairs = zip(self.each(volumes), volumes, strict=True)
        return [blend(own, colour, coverage, self.distances(d)) for own, (colour, coverage, d) in pairs]

    def distances(self, distances: Tensor) -> Tensor:
        """The divisors of the weights: 1 at a photo's place, where that photo, at distance 0, would
        take all the weight."""
        return distances if self.by_distance else torch.ones_like(distances)


class Competing(Mpi):
    """Competing planes (not in the paper), with photos nearest first, as in `liveview render`."""

    def __init__(self, views: int):
        super().__init__(PlaneByPlane(views), target_centred=True)

    def forward(self, photos: Photos, target: Camera, disparities: Tensor, cover: bool = True) -> Rendering:
        return self.batch([(photos, target, disparities)])[0]

    def batch(self, examples: list[tuple[Photos, Camera, Tensor]]) -> list[Rendering]:
        volumes = [volume_at(padded(target), nearest_first(photos, target), d) for photos, target, d in examples]
        renderings = []
        for own, volume, (_, target, _) in zip(self.predictor.each(volumes), volumes, examples, strict=True):
            _, rgb = blend(own, *volume)
            covered = (volume[1] > 0).any(1)
            image = composite_competing(own[:, 0], rgb, covered, torch.zeros_like(own[:, 0])).rgb
            valid = torch.ones(target.height, target.width, dtype=torch.bool)
            renderings.append(Rendering(image[:, : target.height, : target.width], valid))
        return renderings


def nearest_first(photos: Photos, target: Camera) -> Photos:
    """The photos in order of their distance to the target."""
    distances = [float((camera.centre - target.centre).norm()) for camera in photos.cameras]
    order = sorted(range(len(distances)), key=distances.__getitem__)
    return Photos([photos.images[i] for i in order], [photos.cameras[i] for i in order], photos.references)


def competing(views: int) -> Competing:
    """Competing planes, initialised with this project's weights for them."""
    method = Competing(views)
    method.predictor.net.load_state_dict(load_state(MODELS / f"liveview_v{views}_planes.onnx")["average"])
    return method


def liveview(views: int) -> Mpi:
    """Target-centred and dynamic."""
    return Mpi(PlaneByPlane(views), target_centred=True)


def from_agreement(views: int) -> Mpi:
    """The same from this project's initial weights, a plane sweep."""
    predictor = PlaneByPlane(views)
    predictor.net = contiguous_gradients(UNet(views)).to(memory_format=torch.channels_last)
    start_from_agreement(predictor.net)
    return Mpi(predictor, target_centred=True)


def input_centred(views: int) -> Mpi:
    """The paper's ablation: dynamic, but centred at a photo."""
    return Mpi(PlaneByPlane(views, by_distance=False), target_centred=False)
