"""The depth of a photo where other photos confirm it."""

from typing import NamedTuple

import torch
from torch import Tensor

from ..search.photo_depth import PhotoDepth


class ConfirmedDepth(NamedTuple):
    """Disparities [h, w] of a photo that other photos confirm, -1 elsewhere;
    `pixel` as PhotoDepth's."""

    disparity: Tensor
    pixel: float

    @classmethod
    def of(cls, found: PhotoDepth, confirmed: Tensor) -> "ConfirmedDepth":
        """The result of a search, reduced to the confirmed pixels [h, w]."""
        return cls(torch.where(confirmed, found.disparity, -1), found.pixel)
