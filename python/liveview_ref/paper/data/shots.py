"""What the methods are scored on: targets of the rig's scenes and of real photos."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from torch import Tensor

from liveview_ref.data.held_out import case_of, targets_of
from liveview_ref.data.scene import open_scene
from liveview_ref.paths import CONFIGS, ROOT
from liveview_ref.reference.liveview import Camera, uniform_disparities

from ..methods.method import Photos
from . import rig
from .samples import for_fusion
from .scenes import RigScene, Scenes

HELD_OUT = CONFIGS / "evaluation.json"  # real photos that no training has seen
DATA = "rig", "real"


@dataclass
class Shot:
    """A target to render: photos, its camera, the truth [3, H, W] in [0, 1], a function that gives
    planes [D], near to far, by their number, and the truth's disparity [H, W] (1/scene unit) where
    it is known."""

    scene: str
    target: str
    photos: Photos
    camera: Camera
    truth: Tensor
    planes: Callable[[int], Tensor]
    disparity: Tensor | None = None


def shots(data: str, folder: Path, textures: Path, split: str, views: int, scenes: int, targets: int) -> Iterator[Shot]:
    """All targets of a split, from at most so many scenes and targets. Scenes of the rig that the
    folder lacks are made; the targets of real photos are those of HELD_OUT for any split."""
    if data == "real":
        yield from real_shots(folder, views, scenes, targets)
        return
    source = Scenes(folder, textures, split)
    for number in range(min(scenes, len(source))):
        scene = source[number]
        for index in range(min(targets, len(scene.places))):
            yield shot_of(scene, f"{number:04}", index, views)


def shot_of(scene: RigScene, name: str, index: int, views: int) -> Shot:
    camera, truth, disparity = scene.target(index)
    return Shot(name, str(index), scene.photos(views), camera, truth, rig.planes, disparity)


def real_shots(folder: Path, views: int, scenes: int, targets: int) -> Iterator[Shot]:
    """Held-out photos of the scenes in the folder that have enough photos; views nearest first."""
    specs = [(spec, base / spec["path"]) for spec in json.loads(HELD_OUT.read_text()) for base in (folder, ROOT)]
    for spec, path in [(spec, path) for spec, path in specs if path.is_dir()][:scenes]:
        scene = open_scene(path)
        for t in targets_of(scene, spec)[:targets]:
            try:
                case = case_of(scene, spec, t, views)
            except ValueError:  # too few photos
                continue
            images, cameras, references = case.sources, case.cameras, (0,)
            if views == 10:
                images, cameras, references = for_fusion(images, cameras)
            photos = Photos(images, cameras, references)
            planes = partial(uniform_disparities, case.near, case.far)
            yield Shot(spec["name"], scene.names[t], photos, case.target, case.truth, planes)


def window(shot: Shot, left: int, top: int, width: int, height: int) -> Shot:
    """A part of the target."""
    rows, columns = slice(top, top + height), slice(left, left + width)
    disparity = None if shot.disparity is None else shot.disparity[rows, columns]
    camera = shot.camera.with_window(left, top, width, height)
    return replace(shot, camera=camera, truth=shot.truth[:, rows, columns], disparity=disparity)
