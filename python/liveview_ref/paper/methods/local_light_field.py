"""Local light field: the 3D network of Local Light Field Fusion (Mildenhall et al., SIGGRAPH 2019;
its table "Network architecture") from the photos' plane sweep volumes to alpha and the photos'
weights at every point of the planes.

Convolutions 3 x 3 x 3, halved three times in depth, height and width, dilated at 1/8; layer
normalisation and ReLU; nearest upsampling of features and skips together. The paper has no table of
its version: with these widths the network has a fifth fewer parameters than the paper gives.
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from liveview_ref.reference.liveview import blend

from .method import Predictor
from .mpi import Mpi

WIDTH = 8  # channels of the first layer
STRIDE = 8  # of the deepest layer: planes are padded to a multiple of it
INITIAL_PLANES = 64  # number of planes for which alpha is initialised


def block(inputs: int, outputs: int, stride: int = 1, dilation: int = 1, kind: type = nn.Conv3d) -> nn.Sequential:
    """3 x 3 x 3, layer normalisation over channels and points, ReLU."""
    convolution = kind(inputs, outputs, 3, stride, padding=dilation, dilation=dilation, bias=False)
    return nn.Sequential(convolution, nn.GroupNorm(1, outputs), nn.ReLU(inplace=True))


def upsampled(x: Tensor, skip: Tensor) -> Tensor:
    """Both at twice the size, nearest."""
    return F.interpolate(torch.cat([x, skip], 1), scale_factor=2.0)


class LocalLightField(Predictor):
    """The static multiplane image of any number of planes at equal steps of disparity."""

    def __init__(self, views: int, width: int = WIDTH):
        super().__init__()
        self.conv1_1 = block(3 * views, width)
        self.conv1_2 = block(width, 2 * width, 2)
        self.conv2 = nn.Sequential(block(2 * width, 2 * width), block(2 * width, 4 * width, 2))
        self.conv3 = nn.Sequential(
            block(4 * width, 4 * width), block(4 * width, 4 * width), block(4 * width, 8 * width, 2)
        )
        self.conv4 = nn.Sequential(*(block(8 * width, 8 * width, dilation=2) for _ in range(3)))
        self.conv5 = nn.Sequential(
            block(16 * width, 4 * width), block(4 * width, 4 * width), block(4 * width, 4 * width)
        )
        self.conv6 = nn.Sequential(block(8 * width, 2 * width), block(2 * width, 2 * width))
        self.conv7 = nn.Sequential(block(4 * width, width), block(width, width))
        self.out = nn.Conv3d(width, views, 3, padding=1)
        for convolution in (m for m in self.modules() if isinstance(m, nn.Conv3d)):
            nn.init.xavier_uniform_(convolution.weight)
        nn.init.zeros_(self.out.bias)
        # alpha starts at 1 / planes: every plane is visible, none occludes the others
        nn.init.constant_(self.out.bias[:1], -math.log(INITIAL_PLANES - 1))
        self.to(memory_format=torch.channels_last_3d)

    def logits(self, volume: Tensor) -> Tensor:
        """volume [D, V, 3, H, W] -> [D, V, H, W]: of alpha, then of the photos' weights except the
        first, which is 0."""
        planes = len(volume)
        points = volume.flatten(1, 2).transpose(0, 1)[None]  # [1, 3 V, D, H, W]
        points = F.pad(points, (0, 0, 0, 0, 0, -planes % STRIDE), mode="replicate")
        points = points.contiguous(memory_format=torch.channels_last_3d)
        half = self.conv1_2(self.conv1_1(points))
        del points  # the largest of all
        quarter = self.conv2(half)
        eighth = self.conv3(quarter)
        up = self.conv5(upsampled(self.conv4(eighth), eighth))
        up = self.conv6(upsampled(up, quarter))
        return self.out(self.conv7(upsampled(up, half))).float()[0, :, :planes].transpose(0, 1)

    def forward(self, volume: Tensor, coverage: Tensor, distances: Tensor) -> tuple[Tensor, Tensor]:
        # the weights come from the network alone, not from the distances
        return blend(self.logits(volume).contiguous(), volume, coverage, torch.ones_like(distances))


def local_light_field(views: int) -> Mpi:
    """Input-centred, as published: the multiplane image of one photo."""
    return Mpi(LocalLightField(views), target_centred=False)


def target_centred(views: int) -> Mpi:
    """The paper's ablation: static, but at the target."""
    return Mpi(LocalLightField(views), target_centred=True)
