"""LiveView (Ghosh et al., CVPR 2021): the U-Net of its table "Network architecture", one plane at a time.

Photos come in the rig's order, as in the paper; `liveview render` takes them nearest first."""

import math
from pathlib import Path

import torch
from torch import Tensor

from liveview_ref.checkpoint import load_state
from liveview_ref.reference.geometry.camera import Camera
from liveview_ref.reference.render.blend import blend
from liveview_ref.reference.render.composite_competing import composite_competing
from liveview_ref.reference.unet import UNet, start_from_agreement

from ..method import Photos, Predictor, Rendering
from ..mpi import Mpi, padded, volume_at

USUAL = 64  # planes that the start of alpha is made for
MODELS = Path(__file__).parents[4] / "models"
BATCH = 8  # planes per pass of the network where nothing is trained: memory does not grow with their number


class PlaneByPlane(Predictor):
    """The dynamic multiplane image: alpha and the photos' weights of each plane from that plane alone."""

    def __init__(self, views: int, by_distance: bool = True):
        super().__init__()
        self.net, self.by_distance = UNet(views), by_distance
        # alphas start at 1 / planes, as those of the other methods do
        torch.nn.init.constant_(self.net.conv9.bias[:1], -math.log(USUAL - 1))
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
        """The logits of each volume, by one pass over all."""
        logits = self.logits(torch.cat([volume for volume, _, _ in volumes]))
        return [own.contiguous() for own in logits.split([len(volume) for volume, _, _ in volumes])]

    def batch(self, volumes: list[tuple[Tensor, Tensor, Tensor]]) -> list[tuple[Tensor, Tensor]]:
        pairs = zip(self.each(volumes), volumes, strict=True)
        return [blend(own, colour, coverage, self.distances(d)) for own, (colour, coverage, d) in pairs]

    def distances(self, distances: Tensor) -> Tensor:
        """What weights are divided by: at a photo's place that photo, at distance 0, would take them all."""
        return distances if self.by_distance else torch.ones_like(distances)


class Competing(Mpi):
    """Planes that compete (not in the paper), with photos nearest first, as `liveview render` does it."""

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
    """From this project's weights for such planes."""
    method = Competing(views)
    method.predictor.net.load_state_dict(load_state(MODELS / f"liveview_v{views}_planes.pt")["average"])
    return method


def liveview(views: int) -> Mpi:
    """Target-centred and dynamic."""
    return Mpi(PlaneByPlane(views), target_centred=True)


def from_agreement(views: int) -> Mpi:
    """The same from the initial weights that this project starts with: a plane sweep."""
    predictor = PlaneByPlane(views)
    predictor.net = UNet(views).to(memory_format=torch.channels_last)
    start_from_agreement(predictor.net)
    return Mpi(predictor, target_centred=True)


def input_centred(views: int) -> Mpi:
    """The paper's ablation: dynamic, but at a photo's place."""
    return Mpi(PlaneByPlane(views, by_distance=False), target_centred=False)
