"""Photos and their cameras as a scene on disk, with transforms.json, for the program."""

import json
from pathlib import Path

import numpy as np
from torch import Tensor

from ..reference.liveview import Camera
from .image import picture
from .opengl import flip_axes


def write_photo(
    folder: Path, name: str, photo: Tensor, camera: Camera, bounds: tuple[float, float] | None = None
) -> dict:
    """Write a photo [3, H, W]; returns its entry in transforms.json. bounds: near and far
    in scene units."""
    picture(photo).save(folder / name, compress_level=1)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera.rotation.T.numpy(), camera.centre.numpy()
    (fx, _, cx), (_, fy, cy) = camera.k[:2].tolist()
    frame = {"file_path": name, "w": camera.width, "h": camera.height, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy}
    range_ = {} if bounds is None else dict(zip(("near", "far"), map(float, bounds), strict=True))
    return frame | range_ | {"transform_matrix": flip_axes(pose).tolist()}


def write_transforms(folder: Path, frames: list[dict]) -> None:
    (folder / "transforms.json").write_text(json.dumps({"frames": frames}))
