"""The crop of one target that the report's figure shows of every method, truth beside it."""

from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from ..data.image import picture
from .shots import Shot

CROP = 160, 120  # width and height
PICTURE_OF = "0000", "0"  # scene and target


def crop_of(shot: Shot) -> tuple[int, int]:
    """(left, top) of the crop where the truth's depth has the most edges, or its colours, where no depth is known."""
    width, height = min(CROP[0], shot.camera.width), min(CROP[1], shot.camera.height)
    values = shot.truth.mean(0) if shot.disparity is None else shot.disparity
    edges = torch.zeros_like(values)
    edges[:, 1:] += values.diff(dim=1).abs()
    edges[1:] += values.diff(dim=0).abs()
    inside = F.avg_pool2d(edges.sqrt()[None, None], (height, width), stride=4)[0, 0]
    at = int(inside.argmax())
    return at % inside.shape[1] * 4, at // inside.shape[1] * 4


def keep(scores: Path, image: Tensor, shot: Shot, competing: bool) -> None:
    """Beside the scores, if it is the target that the figure shows: the crop, and the truth's."""
    if (shot.scene, shot.target) != PICTURE_OF:
        return
    left, top = crop_of(shot)
    suffix = "_competing" if competing else ""
    truth = scores.with_name(f"{scores.stem.split('_')[0]}_truth.webp")
    for path, x in ((scores.with_name(f"{scores.stem}{suffix}.webp"), image), (truth, shot.truth)):
        picture(x.clamp(0, 1)[:, top : top + CROP[1], left : left + CROP[0]]).save(path, quality=92)
