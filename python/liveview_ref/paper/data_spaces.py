"""Spaces (Flynn et al., "DeepView", CVPR 2019): 100 scenes, each by a rig of sixteen cameras, as its repository
augmentedperception/spaces_dataset holds them: data/800/scene_NNN/models.json and the photos that it names.

models.json is a list of rig positions, each a list of sixteen cameras. As the data set's code/utils.py reads them:
OpenCV axes, metres, `orientation` axis times angle (radians) of cam_from_world, `position` the camera's centre,
fx = focal_length, fy = focal_length * pixel_aspect_ratio. Declared sizes are not always those of the photos, so K is
scaled to these. The depths, 1 to 100 m, are the defaults of code/create_psv.py.

The cameras stand in rows of 4, 5, 4 and 3. DeepView's "large_quad" (code/compute_metrics.py: first rig position, nine
targets) has its inputs at the corners of the first and the third row; these are the paper's four views. The paper does
not name the cameras of its five and ten views: here the quad with the camera in its middle, and the two quincunxes that
stand side by side, with those targets that are no input. DeepView's own metric leaves out 16 pixels at each edge and
40 where a target is at the edge of the quad; here it is 16 everywhere."""

import json
import math
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from ..reference.geometry.camera import Camera
from .captured import CapturedScene

TEST = (0, 9, 10, 23, 24, 52, 56, 62, 63, 73)  # code/compute_metrics.py; all others are for training
VALIDATION_EVERY = 15  # of the scenes for training: ours, the data set has none
CAMERAS = 16
VIEWS = {4: (0, 3, 9, 12), 5: (6, 0, 3, 9, 12), 10: (5, 0, 1, 9, 10, 7, 2, 3, 11, 12)}
REFERENCES = {4: (0,), 5: (0,), 10: (0, 5)}
TARGETS = (1, 2, 4, 5, 6, 7, 8, 10, 11)
NEAR, FAR = 1.0, 100.0  # m


class Spaces:
    """The scenes of a split ("train", "validation" or "test") in data/800, for a number of views."""

    def __init__(self, folder: Path, split: str, views: int):
        if views not in VIEWS:
            raise ValueError(f"Spaces has no configuration of {views} views; expected {', '.join(map(str, VIEWS))}")
        self.views, self.scenes = views, scenes_of(folder, split)

    def __len__(self) -> int:
        return len(self.scenes)

    def __getitem__(self, number: int) -> CapturedScene:
        return read_scene(self.scenes[number], self.views)


def scenes_of(folder: Path, split: str) -> list[Path]:
    """The scenes' folders, by their numbers."""
    found = {int(path.name[6:]): path for path in folder.glob("scene_*") if path.name[6:].isdecimal()}
    training = sorted(set(found) - set(TEST))
    numbers = {
        "train": [n for i, n in enumerate(training) if i % VALIDATION_EVERY],
        "validation": training[::VALIDATION_EVERY],
        "test": sorted(set(found) & set(TEST)),
    }[split]
    if not numbers:
        raise ValueError(f"{folder}: no scene of the {split} split; expected folders scene_000 to scene_099")
    return [found[number] for number in numbers]


def read_scene(folder: Path, views: int) -> CapturedScene:
    """The first rig position of a scene."""
    cameras, names = read_models(folder / "models.json")
    inputs = VIEWS[views]
    targets = [index for index in TARGETS if index not in inputs]
    images = {index: read_photo(folder / names[index]) for index in (*inputs, *targets)}
    sized = {i: cameras[i].with_size_scaled(image.shape[2], image.shape[1]) for i, image in images.items()}
    return CapturedScene(
        folder.name,
        [images[i] for i in inputs],
        [sized[i] for i in inputs],
        REFERENCES[views],
        [f"cam_{i:02}" for i in targets],
        [images[i] for i in targets],
        [sized[i] for i in targets],
        None,
        NEAR,
        FAR,
    )


def read_models(path: Path) -> tuple[list[Camera], list[str]]:
    """Of the first rig position: cameras at their declared sizes, and the photos' paths relative to the scene."""
    try:
        positions = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise ValueError(f"{path} is missing; expected a scene of Spaces") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}; expected JSON") from error
    rig = positions[0] if isinstance(positions, list) and positions else None
    if not isinstance(rig, list) or len(rig) != CAMERAS:
        raise ValueError(f"{path}: [0]: expected a list of {CAMERAS} cameras, the first rig position")
    entries = [Entry(f"{path}: [0][{index}]", entry) for index, entry in enumerate(rig)]
    return [entry.camera() for entry in entries], [entry.text("relative_path") for entry in entries]


class Entry:
    """A camera of models.json; every ValueError names the file and the field."""

    def __init__(self, place: str, fields: object):
        if not isinstance(fields, dict):
            raise ValueError(f"{place}: expected a camera's fields")
        self.place, self.fields = place, fields

    def wrong(self, field: str, expected: str) -> ValueError:
        found = f"found {json.dumps(self.fields[field])}" if field in self.fields else "missing"
        return ValueError(f"{self.place}.{field}: {found}; expected {expected}")

    def text(self, field: str) -> str:
        value = self.fields.get(field)
        if not isinstance(value, str) or not value:
            raise self.wrong(field, "a path relative to the scene")
        return value

    def numbers(self, field: str, count: int) -> list[float]:
        values = self.fields.get(field)
        if not isinstance(values, list) or len(values) != count or not all(map(is_number, values)):
            raise self.wrong(field, f"{count} numbers")
        return values

    def positive(self, field: str) -> float:
        value = self.fields.get(field)
        if not is_number(value) or value <= 0:
            raise self.wrong(field, "a positive number")
        return value

    def camera(self) -> Camera:
        fx, (cx, cy) = self.positive("focal_length"), self.numbers("principal_point", 2)
        k = [[fx, 0, cx], [0, fx * self.positive("pixel_aspect_ratio"), cy], [0, 0, 1]]
        rotation = rotation_of(self.numbers("orientation", 3))
        centre = torch.tensor(self.numbers("position", 3), dtype=torch.float64)
        size = round(self.positive("width")), round(self.positive("height"))
        return Camera(torch.tensor(k, dtype=torch.float64), rotation, -(rotation @ centre), *size)


def is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def rotation_of(axis_angle: list[float]) -> Tensor:
    """Rotation [3, 3] about an axis by its length in radians."""
    x, y, z = axis_angle
    return torch.linalg.matrix_exp(torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=torch.float64))


def read_photo(path: Path) -> Tensor:
    """[3, H, W] uint8"""
    try:
        with Image.open(path) as image:
            return torch.from_numpy(np.array(image.convert("RGB"))).permute(2, 0, 1).contiguous()
    except OSError as error:
        raise ValueError(f"{path}: {error}; expected a photo that models.json names") from error
