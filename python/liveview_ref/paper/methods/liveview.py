"""LiveView (Ghosh et al., CVPR 2021): the U-Net of its table "Network architecture", one plane at a time.

Photos come in the rig's order, as in the paper; `liveview render` takes them nearest first."""

import math

import torch
from torch import Tensor

from ...reference.blend import blend
from ...reference.unet import UNet, start_from_agreement
from ..method import Predictor
from ..mpi import Mpi

USUAL = 64  # planes that the start of alpha is made for
BATCH = 8  # planes per pass of the network where nothing is trained: memory does not grow with their number


class PlaneByPlane(Predictor):
    """The dynamic multiplane image: alpha and the photos' weights of each plane from that plane alone."""

    def __init__(self, views: int):
        super().__init__()
        self.net = UNet(views)
        # alphas start at 1 / planes, as those of the other methods do
        torch.nn.init.constant_(self.net.conv9.bias[:1], -math.log(USUAL - 1))

    def logits(self, volume: Tensor) -> Tensor:
        """volume [D, V, 3, H, W] -> [D, V, H, W]"""
        planes = volume.flatten(1, 2).contiguous(memory_format=torch.channels_last)
        if self.training:
            return self.net(planes).float()
        return torch.cat([self.net(part).float() for part in planes.split(BATCH)])

    def forward(self, volume: Tensor, coverage: Tensor, distances: Tensor) -> tuple[Tensor, Tensor]:
        return blend(self.logits(volume).contiguous(), volume, coverage, distances)

    def batch(self, volumes: list[tuple[Tensor, Tensor, Tensor]]) -> list[tuple[Tensor, Tensor]]:
        logits = self.logits(torch.cat([volume for volume, _, _ in volumes])).split([len(v) for v, _, _ in volumes])
        return [blend(own.contiguous(), *volume) for own, volume in zip(logits, volumes, strict=True)]


def liveview(views: int) -> Mpi:
    """Target-centred and dynamic."""
    return Mpi(PlaneByPlane(views), target_centred=True)


def from_agreement(views: int) -> Mpi:
    """The same from the initial weights that this project starts with: a plane sweep."""
    predictor = PlaneByPlane(views)
    predictor.net = UNet(views)
    start_from_agreement(predictor.net)
    return Mpi(predictor, target_centred=True)


def input_centred(views: int) -> Mpi:
    """The paper's ablation: dynamic, but at a photo's place."""
    return Mpi(PlaneByPlane(views), target_centred=False)
