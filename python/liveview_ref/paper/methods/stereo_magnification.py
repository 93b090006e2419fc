"""Stereo Magnification (Zhou et al., SIGGRAPH 2018), for any number of photos: the
encoder-decoder of its table "Network architecture", which makes all planes at once, centred at
one photo, the reference.

The paper states of its version only that it takes five photos. Interpretation: the plane sweep
volumes of all other photos are the input, in place of that of the original's second photo, and the
output remains the original's (alphas, blending weights, one background image), so that colours come
only from the reference and the background. With the nearest upsampling and 3 x 3 convolution of the
publication's later tables, instead of the 4 x 4 transposed convolutions of its code, the network
has the number of parameters that the paper gives.
"""

import math
from functools import partial

import torch
from torch import Tensor, nn

from . import local_light_field
from .local_light_field import upsampled
from .method import Predictor
from .mpi import Mpi

WIDTH = 64  # channels of the first layer
block = partial(local_light_field.block, kind=nn.Conv2d)


class StereoMagnification(Predictor):
    """All planes of a static multiplane image at the nearest photo (at distance 0)."""

    def __init__(self, views: int, planes: int, width: int = WIDTH):
        super().__init__()
        self.views, self.planes = views, planes
        self.conv1_1 = block(3 + planes * (views - 1) * 3, width)
        self.conv1_2 = block(width, 2 * width, 2)
        self.conv2 = nn.Sequential(block(2 * width, 2 * width), block(2 * width, 4 * width, 2))
        self.conv3 = nn.Sequential(
            block(4 * width, 4 * width), block(4 * width, 4 * width), block(4 * width, 8 * width, 2)
        )
        self.conv4 = nn.Sequential(*(block(8 * width, 8 * width, dilation=2) for _ in range(3)))
        self.conv6 = nn.Sequential(
            block(16 * width, 4 * width), block(4 * width, 4 * width), block(4 * width, 4 * width)
        )
        self.conv7 = nn.Sequential(block(8 * width, 2 * width), block(2 * width, 2 * width))
        self.conv8 = nn.Sequential(block(4 * width, width), block(width, width))
        self.out = nn.Conv2d(width, 2 * planes + 3, 1)
        for convolution in (m for m in self.modules() if isinstance(m, nn.Conv2d)):
            nn.init.xavier_uniform_(convolution.weight)
        nn.init.zeros_(self.out.bias)
        # alpha starts at 1 / planes: every plane is visible, none occludes the others
        nn.init.constant_(self.out.bias[planes : 2 * planes], -math.log(planes - 1) / 2)
        self.to(memory_format=torch.channels_last)

    def encoder_decoder(self, inputs: Tensor) -> Tensor:
        """[1, 3 + 3 D (V - 1), H, W] -> [1, 2 D + 3, H, W], in -1 .. 1"""
        half = self.conv1_2(self.conv1_1(inputs))
        quarter = self.conv2(half)
        eighth = self.conv3(quarter)
        up = self.conv6(upsampled(self.conv4(eighth), eighth))
        up = self.conv7(upsampled(up, quarter))
        return torch.tanh(self.out(self.conv8(upsampled(up, half))).float())

    def forward(self, volume: Tensor, coverage: Tensor, distances: Tensor) -> tuple[Tensor, Tensor]:
        got = tuple(volume.shape[:2])
        if got != (self.planes, self.views):
            made = f"made for {self.planes} planes and {self.views} photos"
            raise ValueError(f"this network is {made}, not {got[0]} planes and {got[1]} photos")
        nearest = int(distances.argmin())
        centred = 2 * volume - coverage[:, :, None]  # -1 .. 1, and 0 where a photo does not cover
        others = [view for view in range(self.views) if view != nearest]
        inputs = torch.cat([centred[0, nearest], centred[:, others].flatten(0, 2)])[None]
        output = self.encoder_decoder(inputs.contiguous(memory_format=torch.channels_last))[0]
        weights, alpha, background = ((x.contiguous() + 1) / 2 for x in output.split([self.planes, self.planes, 3]))
        reference, seen = volume[0, nearest], coverage[0, nearest]
        return alpha, weights[:, None] * reference + (1 - weights * seen)[:, None] * background


def stereo_magnification(views: int, planes: int = 64, width: int = WIDTH) -> Mpi:
    """Input-centred, as published."""
    return Mpi(StereoMagnification(views, planes, width), target_centred=False)
