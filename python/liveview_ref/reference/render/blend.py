"""Network output -> alpha and colour of a layer (paper, section "Rendering the MPI").

The view weights are softmax(0, logit 1 .. logit V-1), times d_min / d_i (the paper's normalisation
by distance, made dimensionless), normalised by coverage. All in the log domain over the views that
cover the pixel, so that neither extreme logits nor extreme distances give 0 / 0.
"""

import torch
from torch import Tensor

CORRECTED_POWER = 1.5  # of d_min / d_i for corrected photos


def distance_bias(distances: Tensor, power: float = 1.0) -> tuple[Tensor, Tensor]:
    """Distances [..., V] of the views to the target -> (power log(d_min / d_i) [..., V], coincident
    [..., V] bool).

    Where the target coincides with a view (d = 0), that view takes all the weight at the pixels it
    covers; d_min is taken over the others, which contribute to the remaining pixels.
    """
    coincident = distances == 0
    nearest = distances.masked_fill(coincident, torch.inf).amin(-1, keepdim=True)
    # Of the quotient: scaling the scene by a power of two leaves every bit unchanged.
    bias = power * torch.log((nearest / distances).clamp_min(torch.finfo(distances.dtype).tiny))
    return bias.masked_fill(coincident, 0.0), coincident


def blend(
    logits: Tensor, colour: Tensor, coverage: Tensor, distances: Tensor, power: float = 1.0
) -> tuple[Tensor, Tensor]:
    """logits [N, V, H, W], colour [N, V, 3, H, W], coverage [N, V, H, W], distances [V] or [N, V]
    -> alpha [N, H, W] (0 where no view covers the pixel), rgb [N, 3, H, W]."""
    bias, coincident = distance_bias(distances.expand(len(logits), -1), power)
    eligible = coverage > 0
    covered = eligible.any(1)
    if bool(coincident.any()):
        coincident = coincident[:, :, None, None]
        on_top = (eligible & coincident).any(1, keepdim=True)
        eligible = eligible & (coincident == on_top)
    limits = torch.finfo(torch.float32)
    finite = logits.clamp(limits.min, limits.max)  # two infinite logits would give a NaN
    scores = torch.cat([torch.zeros_like(finite[:, :1]), finite[:, 1:]], 1) + bias.to(logits)[:, :, None, None]
    scores = scores.masked_fill(~eligible, -torch.inf)
    top = scores.amax(1, keepdim=True)
    weights = torch.exp(scores - top.masked_fill(~covered[:, None], 0.0))  # exp(-inf) = 0 where not eligible
    total = (weights * coverage).sum(1)
    rgb = (weights[:, :, None] * colour).sum(1) / torch.where(covered, total, torch.ones_like(total))[:, None]
    return torch.sigmoid(logits[:, 0]) * covered, rgb
