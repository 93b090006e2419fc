"""A rig's photos and cameras as plain arrays.

`view{i}.image` [h, w, 3] float32, the nearest view first; `k`, `rotation` [3, 3] and `translation`
[3] float64 (cam_from_world) of `view{i}` and `target`; `target.size` (width, height).
"""

import numpy as np
import torch
from torch import Tensor

from .reference.liveview import Camera

Arrays = dict[str, np.ndarray]


def cameras_of(data: Arrays) -> tuple[list[Camera], Camera]:
    """The views' cameras, nearest first, and the target's."""

    def camera(name: str, width: int, height: int) -> Camera:
        parts = (torch.from_numpy(data[f"{name}.{x}"].astype(np.float64)) for x in ("k", "rotation", "translation"))
        return Camera(*parts, width, height)

    count = sum(name.endswith(".image") for name in data)
    images = [data[f"view{i}.image"] for i in range(count)]
    views = [camera(f"view{i}", image.shape[1], image.shape[0]) for i, image in enumerate(images)]
    return views, camera("target", *(int(x) for x in data["target.size"]))


def images_of(data: Arrays, dtype: torch.dtype) -> list[Tensor]:
    count = sum(name.endswith(".image") for name in data)
    return [torch.from_numpy(data[f"view{i}.image"]).to(dtype).permute(2, 0, 1).contiguous() for i in range(count)]
