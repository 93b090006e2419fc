"""Photos and their cameras as a scene on disk, with transforms.json, for the program."""

import json
from pathlib import Path

import numpy as np
from torch import Tensor

from ..reference.liveview import Camera
from .image import picture
from .opengl import flip_axes


def write_scene(
    folder: Path,
    photos: list[Tensor],
    cameras: list[Camera],
    bounds: tuple[float, float] | None = None,
    lens: dict[str, float] | None = None,
) -> None:
    """Write photos [3, H, W] as 000.png, 001.png ... and transforms.json. bounds: near and far in
    scene units; lens: distortion, by the names of its fields."""
    frames = []
    for i, (photo, camera) in enumerate(zip(photos, cameras, strict=True)):
        name = f"{i:03}.png"
        picture(photo).save(folder / name, compress_level=1)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = camera.rotation.T.numpy(), camera.centre.numpy()
        (fx, _, cx), (_, fy, cy) = camera.k[:2].tolist()
        frame = {"file_path": name, "w": camera.width, "h": camera.height, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy}
        range_ = {} if bounds is None else dict(zip(("near", "far"), map(float, bounds), strict=True))
        frames.append(frame | range_ | (lens or {}) | {"transform_matrix": flip_axes(pose).tolist()})
    (folder / "transforms.json").write_text(json.dumps({"frames": frames}))
