"""Logits without a network, from how well the views agree on a pixel's colour; and a network whose
output is added to them. Not in the paper."""

import torch
from torch import Tensor

from .liveview import UNet

HALF_AGREEMENT = 0.08  # colours that differ by this much (root mean square over the channels) agree by one half
STRENGTH = 2.0  # logit of full agreement


def agreement_logits(colour: Tensor, coverage: Tensor) -> Tensor:
    """colour [L, V, 3, H, W], coverage [L, V, H, W], 0 where a view does not see the layer (such
    views are left out) -> logits [L, V, H, W]: for alpha the mean agreement of the views, for each
    view after the first its agreement minus the first view's."""
    shown = (coverage > 0).to(colour)
    agreement = torch.zeros_like(shown)
    for other in range(colour.shape[1]):
        squares = (colour - colour[:, other : other + 1]).square().sum(2)
        difference = squares / (3 * HALF_AGREEMENT**2)
        agreement += shown * shown[:, other : other + 1] / (1 + difference)
    count = shown.sum(1, keepdim=True).clamp(min=1)
    logits = STRENGTH / count * (agreement - agreement[:, :1])
    logits[:, 0] = (STRENGTH / count * agreement.sum(1, keepdim=True) / count)[:, 0]
    return logits


class AgreementUNet(UNet):
    """The paper's network, its output added to the logits of the views' agreement. Its input has no
    coverage, so a black pixel counts as one that the view does not see."""

    def forward(self, hwv: Tensor) -> Tensor:
        colour = hwv.unflatten(1, (self.views, 3))
        return super().forward(hwv) + agreement_logits(colour, colour.sum(2))
