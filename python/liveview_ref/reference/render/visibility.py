"""Per-view occlusion: an occluded sample of a view has neither colour nor coverage.

Where the coverage that remains, summed over the views, is 0.05 or less, the occlusion of all views
is ignored, and the pixel counts as occluded.
"""

import torch
from torch import Tensor

LEAST_COVERAGE = 0.05  # summed over the views; a pixel with more is seen


def hide(masks: Tensor, colour: Tensor, coverage: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Colour [V, 3, h, w] and coverage [V, h, w] of a layer without the occluded samples, where
    masks [V, h, w] are 0; and whether any view sees the pixel, [h, w] bool."""
    left = torch.zeros_like(coverage[0])
    for mask, covered in zip(masks, coverage, strict=True):
        left = left + mask * covered
    seen = left > LEAST_COVERAGE
    masks = torch.where(seen, masks, 1)
    return colour * masks[:, None], coverage * masks, seen
