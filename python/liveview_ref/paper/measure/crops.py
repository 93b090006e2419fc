"""The crop of one target that the report's figure shows of every method and of the truth."""

from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from liveview_ref.data.image import picture

from ..data.shots import Shot

CROP = 160, 120  # width and height, pixels
PICTURE_OF = "0000", "0"  # scene and target


def crop_of(shot: Shot) -> tuple[int, int]:
    """(left, top) of the crop with the most edges of the truth's depth, or of its colours if no
    depth is known."""
    width, height = min(CROP[0], shot.camera.width), min(CROP[1], shot.camera.height)
    values = shot.truth.mean(0) if shot.disparity is None else shot.disparity
    edges = torch.zeros_like(values)
    edges[:, 1:] += values.diff(dim=1).abs()
    edges[1:] += values.diff(dim=0).abs()
    inside = F.avg_pool2d(edges.sqrt()[None, None], (height, width), stride=4)[0, 0]
    at = int(inside.argmax())
    return at % inside.shape[1] * 4, at // inside.shape[1] * 4


def keep(folder: Path, name: str, image: Tensor, shot: Shot) -> None:
    """Write the crop to FOLDER/NAME.webp, and the truth's to FOLDER/truth.webp, if the figure shows
    this target."""
    if (shot.scene, shot.target) != PICTURE_OF:
        return
    folder.mkdir(parents=True, exist_ok=True)
    left, top = crop_of(shot)
    for path, x in ((folder / f"{name}.webp", image), (folder / "truth.webp", shot.truth)):
        picture(x.clamp(0, 1)[:, top : top + CROP[1], left : left + CROP[0]]).save(path, quality=92)
