"""Weights of networks: the start of a training, BatchNorm folded, other numbers of views."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .reference.liveview import UNet

# By how much the logits of views that a network gets beyond those of its start are lower: 64 planes
# on validation photos, V = 5 before any training: 27.26 dB with 0, 27.34 with 2.
FURTHER = 2.0


def contiguous_gradients(net: UNet) -> UNet:
    """The network, trained faster: concatenation gives back a slice of its gradient, and
    interpolating that slice directly takes four times as long."""

    def hook(_layer: nn.Module, _inputs: tuple, y: Tensor) -> None:
        if y.requires_grad:
            y.register_hook(lambda g: g.contiguous(memory_format=torch.channels_last))

    for layer in (net.ups5, net.ups6, net.ups7):
        layer.register_forward_hook(hook)
    return net


def start_from_agreement(net: UNet) -> None:
    """Initialise the weights as a plane sweep: conv1 takes signed differences of pairs of
    views, conv8 and conv9 average them over a window, so that a layer is more opaque the better
    its views agree."""
    pairs = [(i, j) for i in range(net.views) for j in range(i + 1, net.views)]  # the nearest view's first
    differences = 14  # of 16 channels: seven pairs (or colours of them), both signs
    with torch.no_grad():
        first, window, alpha = net.conv1[0].weight, net.conv8[0].weight, net.conv9.weight
        first.mul_(0.2)
        for channel in range(differences):
            (a, b), colour = pairs[channel // 2 % len(pairs)], channel // 2 // len(pairs) % 3
            mix = torch.full((3,), 1 / 3) if colour == 0 else torch.eye(3)[colour]
            sign = 1 - channel % 2 * 2
            first[channel, 3 * a : 3 * a + 3, 1, 1] += sign * mix
            first[channel, 3 * b : 3 * b + 3, 1, 1] -= sign * mix
        for channel, sign in ((0, 1), (1, -1)):  # BatchNorm and ReLU keep one half each
            window[channel].mul_(0.1)
            window[channel, 32 : 32 + differences] += sign / (9 * differences)
            alpha[0, channel] -= 0.3 * sign


def adapt_views(state: dict[str, Tensor], net: UNet) -> None:
    """Initialise `net` from the weights of another V: inner layers unchanged. Views beyond those of
    the start change nothing at first but the blend, in which they have a lower weight than its last
    one, being farther. If there are fewer, the last has the weights of those that are missing."""
    own = net.state_dict()
    for name, value in state.items():
        if own[name].shape == value.shape:
            own[name] = value
        elif name == "conv1.0.weight":
            shared = min(value.shape[1], own[name].shape[1])
            own[name] = F.pad(value[:, :shared], (0, 0, 0, 0, 0, own[name].shape[1] - shared))
            own[name][:, shared - 3 : shared] += value[:, shared:].unflatten(1, (-1, 3)).sum(1)
        else:  # conv9: alpha, and a weight for every view but the first
            own[name] = value[[min(v, len(value) - 1) for v in range(net.views)]]
            if name == "conv9.bias":
                own[name][len(value) :] -= FURTHER
    net.load_state_dict(own)


def fold_batchnorm(net: UNet) -> UNet:
    """A copy for inference in which each BatchNorm is folded into its convolution."""
    folded = type(net)(net.views).to(next(net.parameters()).dtype).eval()
    folded.conv9.load_state_dict(net.conv9.state_dict())
    for index in range(1, 9):
        name = f"conv{index}"
        source = getattr(net, name)
        fused = torch.nn.utils.fusion.fuse_conv_bn_eval(source[0].eval(), source[1].eval())
        setattr(folded, name, nn.Sequential(fused, nn.ReLU(inplace=True)))
    return folded


def with_views(net: UNet, views: int) -> UNet:
    """A network with BatchNorm folded, for this number of views: `net` if it has as many."""
    if net.views == views:
        return net
    other = fold_batchnorm(type(net)(views).eval())
    adapt_views(net.state_dict(), other)
    return other


def unfold_batchnorm(net: UNet) -> UNet:
    """A folded network with identity BatchNorms, in the form of checkpoints."""
    full = type(net)(net.views).eval()
    full.conv9.load_state_dict(net.conv9.state_dict())
    for index in range(1, 9):
        convolution, norm = getattr(full, f"conv{index}")[:2]
        folded = getattr(net, f"conv{index}")[0]
        convolution.weight.data.copy_(folded.weight.data)
        norm.bias.data.copy_(folded.bias.data)
        norm.running_var.fill_(1 - norm.eps)
    return full
