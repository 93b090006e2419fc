"""Training samples of the paper's own data sets, and what a folder of training data is, by what lies in it."""

from pathlib import Path

import numpy as np

from .data_deepfocus import DeepFocus
from .data_spaces import Spaces
from .samples import CROP, SEED, RealSamples, Sample

KINDS = {"spaces": ("scene_*", Spaces), "deepfocus": ("seed*", DeepFocus)}


class CapturedSamples:
    """Of the training split of Spaces or DeepFocus."""

    def __init__(self, folder: Path, kind: str):
        self.folder, self.kind, self.opened = folder, kind, {}

    def __call__(self, views: int, number: int) -> Sample:
        """Sample `number`, of the number, the seed and the number of views alone."""
        if views not in self.opened:
            self.opened[views] = KINDS[self.kind][1](self.folder, "train", views)
        rng = np.random.default_rng([SEED, 2, number])
        scenes = self.opened[views]
        scene = scenes[int(rng.integers(len(scenes)))]
        camera, image, _ = scene.target(int(rng.integers(len(scene.places))))
        left, top = (int(rng.integers(0, length - CROP + 1)) for length in (camera.width, camera.height))
        truth = image[:, top : top + CROP, left : left + CROP]
        return Sample(scene.photos(views), camera.with_window(left, top, CROP, CROP), truth, scene.near, scene.far)


def kind_of(folder: Path) -> str:
    """spaces, deepfocus or real: posed photos, train/ of ../shared/data's kind."""
    found = [kind for kind, (pattern, _) in KINDS.items() if any(folder.glob(pattern))]
    return found[0] if found else "real"


def samples_of(folder: Path) -> RealSamples | CapturedSamples:
    """What training draws from a folder of data."""
    kind = kind_of(folder)
    return RealSamples(folder) if kind == "real" else CapturedSamples(folder, kind)
