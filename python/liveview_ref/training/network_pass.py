"""A pass of the network over many planes whose gradient is taken for a few of them.

The pass keeps its activations. Autograd would propagate through all planes of a call or through
none; here the gradient of the planes that were drawn is computed from their rows of the
activations, so that these planes do not pass through the network a second time. Convolutions in
bfloat16 where the hardware computes in it, channels last; BatchNorm is folded (fine_tune.py).
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..reference.unet import UNet
from .precision import fast_bfloat16

CHUNK = 16  # planes at a time, as many as fit the cache
LAST = torch.channels_last


def convolutions(net: UNet) -> list[nn.Conv2d]:
    """conv1 to conv9."""
    return [layer[0] if isinstance(layer, nn.Sequential) else layer for layer in net.children()]


def upsampled(x: Tensor, skip: Tensor) -> Tensor:
    """The input of conv6 to conv8: x at twice its size, and the skip connection."""
    return torch.cat([F.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False), skip], 1)


def forward(layers: list[nn.Conv2d], weights: list[Tensor], hwv: Tensor) -> list[Tensor]:
    """The input and the output of every layer, the logits last."""
    biases = [layer.bias.to(hwv.dtype) for layer in layers]

    def conv(index: int, x: Tensor) -> Tensor:
        y = F.conv2d(x, weights[index], biases[index], layers[index].stride, padding=1)
        return y if index == 8 else y.relu_()

    kept = [hwv]
    for index in range(5):
        kept.append(conv(index, kept[-1]))
    for index, skip in zip((5, 6, 7), (3, 2, 1), strict=True):
        kept.append(conv(index, upsampled(kept[-1], kept[skip])))
    return [*kept, conv(8, kept[-1])]


def backward(layers: list[nn.Conv2d], weights: list[Tensor], kept: list[Tensor], gradient: Tensor) -> list[Tensor]:
    """Gradients of the weight and bias of each layer, given the gradient of the logits."""
    found: list[Tensor] = [torch.empty(0)] * 18
    skipped: dict[int, Tensor] = {}  # gradients that reach conv1 to conv3 by the skip connections

    def conv(index: int, x: Tensor, g: Tensor) -> Tensor:
        wanted = [index > 0, True, True]  # the photos need no gradient
        stride = layers[index].stride
        gx, *found[2 * index : 2 * index + 2] = torch.ops.aten.convolution_backward(
            g, x, weights[index], [len(layers[index].bias)], stride, [1, 1], [1, 1], False, [0, 0], 1, wanted
        )
        return gx

    g = conv(8, kept[8], gradient)
    for index, skip in ((7, 1), (6, 2), (5, 3)):
        below = kept[index]
        g = torch.ops.aten.threshold_backward(g, kept[index + 1], 0)
        g = conv(index, upsampled(below, kept[skip]), g)
        channels = below.shape[1]
        skipped[skip] = g[:, channels:]
        g = torch.ops.aten.upsample_bilinear2d_backward(
            g[:, :channels].contiguous(memory_format=LAST), kept[skip].shape[2:], below.shape, False, 2.0, 2.0
        )
    for index in (4, 3, 2, 1, 0):
        if index + 1 in skipped:
            g = g + skipped[index + 1]
        g = torch.ops.aten.threshold_backward(g, kept[index + 1], 0)
        g = conv(index, kept[index], g)
    return found


class NetworkPass:
    """The logits [L, V, H, W] float32, without gradients, of planes whose warped views are
    [L, V, 3, H, W]."""

    def __init__(self, net: UNet, colour: Tensor):
        self.layers = convolutions(net)
        self.dtype = torch.bfloat16 if fast_bfloat16() else torch.float32
        self.weights = [layer.weight.detach().to(self.dtype, memory_format=LAST) for layer in self.layers]
        hwv = colour.flatten(1, 2).to(self.dtype, memory_format=LAST)
        with torch.no_grad():
            self.chunks = [forward(self.layers, self.weights, part) for part in hwv.split(CHUNK)]
        self.logits = torch.cat([kept[-1] for kept in self.chunks]).float().contiguous()

    def of(self, ids: Tensor) -> Tensor:
        """The logits of the planes `ids`, with the graph of their gradient."""
        parameters = [p for layer in self.layers for p in (layer.weight, layer.bias)]
        return _Some.apply(self, ids, *parameters)


class _Some(torch.autograd.Function):
    @staticmethod
    def forward(ctx, whole: NetworkPass, ids: Tensor, *parameters: Tensor) -> Tensor:
        ctx.whole, ctx.ids = whole, ids
        return whole.logits[ids]

    @staticmethod
    def backward(ctx, gradient: Tensor):
        whole, ids = ctx.whole, ctx.ids
        order = ids.argsort()  # rows are gathered chunk by chunk
        ids, gradient = ids[order], gradient[order].to(whole.dtype, memory_format=LAST)
        rows = [ids[ids // CHUNK == n] - n * CHUNK for n in range(len(whole.chunks))]
        kept = [
            torch.cat([part[own] for part, own in zip(parts, rows, strict=True) if len(own)])
            for parts in zip(*whole.chunks, strict=True)
        ]
        found = backward(whole.layers, whole.weights, kept, gradient)
        return None, None, *(g.float() for g in found)
