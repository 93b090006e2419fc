"""What the methods are scored on: targets of the rig's scenes, of the paper's own data sets, and of real photos."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from torch import Tensor

from ..data.held_out import case_of, targets_of
from ..data.scene import open_scene
from ..reference.geometry.camera import Camera
from ..reference.layers.uniform import uniform_disparities
from . import rig
from .captured import CapturedScene
from .data_deepfocus import DeepFocus
from .data_spaces import Spaces
from .method import Photos
from .samples import for_fusion
from .scenes import RigScene, Scenes

REAL = Path(__file__).parents[2] / "configs" / "evaluation.json"
DATA = "rig", "spaces", "deepfocus", "real"


@dataclass
class Shot:
    """A target to render: photos, its camera, the truth [3, H, W] in [0, 1], planes of any number [D] near to far, and
    the truth's disparity [H, W] (1/scene unit) where the data has it."""

    scene: str
    target: str
    photos: Photos
    camera: Camera
    truth: Tensor
    planes: Callable[[int], Tensor]
    disparity: Tensor | None = None


def shots(data: str, folder: Path, textures: Path, split: str, views: int, scenes: int, targets: int) -> Iterator[Shot]:
    """All targets of a split, of so many scenes and targets at most. The rig's scenes are made where the folder lacks
    them; of real photos the split is what configs/evaluation.json holds out, whatever it is called."""
    if data == "real":
        yield from real_shots(folder, views, scenes, targets)
        return
    if data == "rig":
        source = Scenes(folder, textures, split)
    else:
        source = {"spaces": Spaces, "deepfocus": DeepFocus}[data](folder, split, views)
    for number in range(min(scenes, len(source))):
        scene = source[number]
        name = getattr(scene, "name", f"{number:04}")
        for index in range(min(targets, len(scene.places))):
            yield shot_of(scene, name, index, views)


def shot_of(scene: RigScene | CapturedScene, name: str, index: int, views: int) -> Shot:
    camera, truth, disparity = scene.target(index)
    captured = isinstance(scene, CapturedScene)
    planes = scene.planes if captured else rig.planes
    # which targets a captured scene has depends on the views: an index would be another target
    target = scene.places[index] if captured else str(index)
    known = disparity if bool((disparity > 0).all()) else None
    return Shot(name, target, scene.photos(views), camera, truth, planes, known)


def real_shots(folder: Path, views: int, scenes: int, targets: int) -> Iterator[Shot]:
    """Held-out photos of the scenes that the folder has and that have photos enough; views nearest first."""
    root = Path(__file__).parents[3]
    specs = [(spec, base / spec["path"]) for spec in json.loads(REAL.read_text()) for base in (folder, root)]
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
