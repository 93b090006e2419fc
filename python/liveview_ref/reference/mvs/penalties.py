"""What a path of the aggregation pays for a jump to another index."""

from torch import Tensor

from .photo_sweep import UNIT
from .settings import Settings


def jumps(photo: Tensor, settings: Settings) -> tuple[Tensor, Tensor]:
    """Penalties of a jump from the cell on the left [h, w - 1] and from the one above [h - 1, w], int64."""

    def penalty(difference: Tensor) -> Tensor:
        r, g, b = difference.abs()
        jump = settings.jump / (1 + (((r + g) + b) / 3) / settings.edge)
        return (jump.clamp(min=1.01 * settings.step) * UNIT + 0.5).floor().long()

    return penalty(photo[:, :, 1:] - photo[:, :, :-1]), penalty(photo[:, 1:] - photo[:, :-1])
