"""Training samples: crops of targets, and the photos to render them from. Sample n is the same for
every method."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from liveview_ref.config import read_config
from liveview_ref.data.examples import RealScene
from liveview_ref.paths import CONFIGS
from liveview_ref.reference.liveview import Camera

from ..methods.method import Photos
from .rig import FAR, NEAR
from .scenes import RigScene, Scenes

CROP = 64  # pixels
SEED = 17
TRAINED = CONFIGS / "v4.json"  # its "real": the real scenes that the shipped models are trained on


@dataclass
class Sample:
    """A crop of a target: photos, its camera and image [3, CROP, CROP], the depth range in scene
    units, and the scene if its depth is known."""

    photos: Photos
    target: Camera
    truth: Tensor
    near: float
    far: float
    scene: RigScene | None = None

    def disparity_at(self, camera: Camera) -> Tensor:
        """Disparity [H, W] in a window of one of the scene's cameras; NaN where unknown."""
        found = torch.full((camera.height, camera.width), torch.nan)
        if self.scene is None:
            return found
        whole, disparity = self.scene.at(camera.centre)
        left, top = (round(float(whole.k[i, 2] - camera.k[i, 2])) for i in (0, 1))
        rows = slice(max(top, 0), min(top + camera.height, whole.height))
        columns = slice(max(left, 0), min(left + camera.width, whole.width))
        inside = slice(rows.start - top, rows.stop - top), slice(columns.start - left, columns.stop - left)
        found[inside] = disparity[rows, columns]
        return found


class RigSamples:
    """Samples of the rig's scenes."""

    def __init__(self, scenes: Scenes):
        self.scenes = scenes

    def __call__(self, views: int, number: int) -> Sample:
        """Sample `number`, determined by the number and the seed."""
        rng = np.random.default_rng([SEED, number])
        scene = self.scenes[int(rng.integers(len(self.scenes)))]
        camera, image, _ = scene.target(int(rng.integers(len(scene.places))))
        left, top = (int(rng.integers(0, length - CROP + 1)) for length in (camera.width, camera.height))
        truth = image[:, top : top + CROP, left : left + CROP]
        return Sample(scene.photos(views), camera.with_window(left, top, CROP, CROP), truth, NEAR, FAR, scene)


class RealSamples:
    """Samples of real photos of unknown depth: the V nearest views, nearest first, or some a little
    farther away."""

    def __init__(self, data: Path):
        self.data, self.specs, self.scenes = data, read_config(TRAINED)["real"], {}

    def __call__(self, views: int, number: int) -> Sample:
        """Sample `number`, determined by the number, the seed and the number of views: not every
        scene has ten views around a target."""
        if views not in self.scenes:
            self.scenes[views] = [RealScene(self.data, spec, views) for spec in self.specs]
        scenes = self.scenes[views]
        weights = np.array([scene.weight for scene in scenes])
        rng = np.random.default_rng([SEED, 1, number])
        drawn = scenes[rng.choice(len(scenes), p=weights / weights.sum())].draw(rng, views, (CROP, CROP))
        images, cameras, truth, target, near, far, _ = drawn
        images, cameras, references = for_fusion(images, cameras) if views == 10 else (images, cameras, (0,))
        return Sample(Photos(images, cameras, references), target, truth, float(near), float(far))


def for_fusion(images: list, cameras: list) -> tuple[list, list, tuple[int, int]]:
    """Ten views, nearest first, as two groups of five that start with their reference."""
    order = [0, 2, 4, 6, 8, 1, 3, 5, 7, 9]
    return [images[i] for i in order], [cameras[i] for i in order], (0, 5)
