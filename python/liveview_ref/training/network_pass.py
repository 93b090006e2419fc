"""A pass of the network over many planes whose gradient is taken for a few of them.

The pass keeps its activations. Autograd would propagate through all planes of a call or through
none; here the gradient of the planes that were drawn is computed from their rows of the
activations, so that these planes do not pass through the network a second time. Convolutions in
bfloat16 where the hardware computes in it, channels last; BatchNorm is folded (fine_tune.py).
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..reference.liveview import UNet
from .precision import fast_bfloat16

CHUNK = 16  # planes at a time, as many as fit the cache
LAST = torch.channels_last
SKIPS = {5: 3, 6: 2, 7: 1}  # index of conv6 to conv8: of the activation that the skip connection adds


def convolutions(net: UNet) -> list[nn.Conv2d]:
    """conv1 to conv9."""
    layers = (getattr(net, f"conv{n}") for n in range(1, 10))
    return [layer[0] if isinstance(layer, nn.Sequential) else layer for layer in layers]


def upsampled(x: Tensor) -> Tensor:
    return F.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)


def weights_of(layers: list[nn.Conv2d], dtype: torch.dtype) -> list[list[Tensor]]:
    """The weight of each layer; of conv6 to conv8 in two parts, for the upsampled input and for the
    skip connection: two convolutions and a sum take less time than one of the concatenation."""

    def parts(index: int) -> list[Tensor]:
        weight = layers[index].weight.detach().to(dtype)
        joined = (index - 1, SKIPS[index] - 1) if index in SKIPS else ()
        sizes = [layers[n].out_channels for n in joined] or weight.shape[1]
        return [part.contiguous(memory_format=LAST) for part in weight.split(sizes, 1)]

    return [parts(index) for index in range(9)]


def forward(layers: list[nn.Conv2d], weights: list[list[Tensor]], hwv: Tensor) -> list[Tensor]:
    """The input and the output of every layer, the logits last."""
    biases = [layer.bias.to(hwv.dtype) for layer in layers]

    def conv(index: int, x: Tensor, *skip: Tensor) -> Tensor:
        y = F.conv2d(x, weights[index][0], biases[index], layers[index].stride, padding=1)
        for more in skip:
            y += F.conv2d(more, weights[index][1], padding=1)
        return y if index == 8 else y.relu_()

    kept = [hwv]
    for index in range(5):
        kept.append(conv(index, kept[-1]))
    for index, skip in SKIPS.items():
        kept.append(conv(index, upsampled(kept[-1]), kept[skip]))
    return [*kept, conv(8, kept[-1])]


def backward(
    layers: list[nn.Conv2d], weights: list[list[Tensor]], kept: list[Tensor], gradient: Tensor
) -> list[Tensor]:
    """Gradients of the weight and bias of each layer, given the gradient of the logits."""
    found: list[Tensor] = [torch.empty(0)] * 18
    skipped: dict[int, Tensor] = {}  # gradients that reach conv1 to conv3 by the skip connections

    def conv(index: int, g: Tensor, *inputs: Tensor) -> list[Tensor]:
        wanted = [index > 0, True, True]  # the photos need no gradient
        stride, bias = layers[index].stride, [layers[index].out_channels]
        each = [
            torch.ops.aten.convolution_backward(g, x, weight, bias, stride, [1, 1], [1, 1], False, [0, 0], 1, wanted)
            for x, weight in zip(inputs, weights[index], strict=True)
        ]
        found[2 * index] = torch.cat([gw for _, gw, _ in each], 1)
        found[2 * index + 1] = each[0][2]
        return [gx for gx, _, _ in each]

    [g] = conv(8, gradient, kept[8])
    for index in (7, 6, 5):
        below, skip = kept[index], SKIPS[index]
        g = torch.ops.aten.threshold_backward(g, kept[index + 1], 0)
        g, skipped[skip] = conv(index, g, upsampled(below), kept[skip])
        g = torch.ops.aten.upsample_bilinear2d_backward(g, kept[skip].shape[2:], below.shape, False, 2.0, 2.0)
    for index in (4, 3, 2, 1, 0):
        if index + 1 in skipped:
            g = g + skipped[index + 1]
        g = torch.ops.aten.threshold_backward(g, kept[index + 1], 0)
        [g] = conv(index, g, kept[index])
    return found


class NetworkPass:
    """The logits [L, V, H, W] float32, without gradients, of planes whose warped views are
    [L, V, 3, H, W]."""

    def __init__(self, net: UNet, colour: Tensor):
        self.layers = convolutions(net)
        self.dtype = torch.bfloat16 if fast_bfloat16() else torch.float32
        self.weights = weights_of(self.layers, self.dtype)
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
