"""The paper's U-Net (its table "Network architecture") for any V: HWV [N, 3V, H, W] -> logits
[N, V, H, W].

conv1 .. conv5 go down to 1/8, conv6 .. conv8 up again with skips; 3x3, BatchNorm + ReLU except
conv9. 391,680 convolution weights at V = 4; 28,800 multiply-adds per pixel and layer. H and W are
multiples of 8.
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .network.view_agreement import agreement_logits

# By how much the logits of views that a network gets beyond those of its start are lower: 64 planes
# on validation photos, V = 5 before any training: 27.26 dB with 0, 27.34 with 2.
FURTHER = 2.0


def block(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, padding=1, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)
    )


class UNet(nn.Module):
    """With `agreement` its output is added to the logits of the views' agreement (not in the
    paper)."""

    def __init__(self, views: int, agreement: bool = False):
        super().__init__()
        self.views, self.agreement = views, agreement
        self.conv1 = block(3 * views, 16)
        self.conv2 = block(16, 32, 2)
        self.conv3 = block(32, 64, 2)
        self.conv4 = block(64, 128, 2)
        self.conv5 = block(128, 128)
        self.conv6 = block(192, 64)
        self.conv7 = block(96, 32)
        self.conv8 = block(48, 16)
        self.conv9 = nn.Conv2d(16, views, 3, padding=1)

    def forward(self, hwv: Tensor) -> Tensor:
        full = self.conv1(hwv)
        half = self.conv2(full)
        quarter = self.conv3(half)
        deep = self.conv5(self.conv4(quarter))
        up = self.conv6(torch.cat([upsample(deep), quarter], 1))
        up = self.conv7(torch.cat([upsample(up), half], 1))
        up = self.conv8(torch.cat([upsample(up), full], 1))
        logits = self.conv9(up)
        return logits + agreement_logits(hwv.unflatten(1, (self.views, 3))) if self.agreement else logits


def upsample(x: Tensor) -> Tensor:
    y = F.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)
    if y.requires_grad and not torch.compiler.is_exporting():
        # Concatenation gives back a slice of its gradient; interpolating that slice directly takes
        # four times as long.
        y.register_hook(lambda g: g.contiguous(memory_format=torch.channels_last))
    return y


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
    folded = UNet(net.views, net.agreement).to(next(net.parameters()).dtype).eval()
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
    other = fold_batchnorm(UNet(views, net.agreement).eval())
    adapt_views(net.state_dict(), other)
    return other


def unfold_batchnorm(net: UNet) -> UNet:
    """A folded network with identity BatchNorms, in the form of checkpoints."""
    full = UNet(net.views, net.agreement).eval()
    full.conv9.load_state_dict(net.conv9.state_dict())
    for index in range(1, 9):
        convolution, norm = getattr(full, f"conv{index}")[:2]
        folded = getattr(net, f"conv{index}")[0]
        convolution.weight.data.copy_(folded.weight.data)
        norm.bias.data.copy_(folded.bias.data)
        norm.running_var.fill_(1 - norm.eps)
    return full
