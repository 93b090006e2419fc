"""Random scenes in front of the fixed rig: textured objects at random places in a room, similar to
DeepFocus's data.

A scene is determined by the seed, its split and its number; it is made when first needed and kept
in a folder."""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from liveview_ref.data.procedural.scene import Recipe, render
from liveview_ref.data.procedural.textures import Textures
from liveview_ref.data.procedural.world import World
from liveview_ref.data.shards import eight_bit
from liveview_ref.reference.liveview import Camera

from ..files import put
from ..methods.method import Photos
from .rig import CENTRES, FAR, HEIGHT, NEAR, REFERENCES, SIDE, VIEWS, WIDTH, camera, target_places

SEED = 2021
SPLITS = {"train": 96, "validation": 6, "test": 10}  # scenes
TARGETS = 2  # of a scene
RECIPE = Recipe(things=(12, 26), thin=0.3)


@dataclass
class RigScene:
    """images [11 + TARGETS, 3, H, W] uint8 of the rig's cameras, then the targets; disparities
    [11 + TARGETS, H, W] float16 of their nearest surfaces (1/scene unit); places of the targets in
    sides of the rig's square."""

    images: Tensor
    disparities: Tensor
    places: list[tuple[float, float]]

    def target(self, index: int) -> tuple[Camera, Tensor, Tensor]:
        """Its camera, image [3, H, W] in [0, 1] and disparity [H, W]."""
        at = len(CENTRES) + index
        return camera(*self.places[index]), self.images[at].float() / 255, self.disparities[at].float()

    def at(self, centre: Tensor) -> tuple[Camera, Tensor]:
        """The whole camera at this centre, and its disparity [H, W]."""
        cameras = [camera(*place) for place in [*CENTRES, *self.places]]
        nearest = min(range(len(cameras)), key=lambda i: float((cameras[i].centre - centre).norm()))
        return cameras[nearest], self.disparities[nearest].float()

    def photos(self, views: int) -> Photos:
        """The rig's photos for that number of views."""
        ids = VIEWS[views]
        images = [self.images[i].float() / 255 for i in ids]
        return Photos(images, [camera(*CENTRES[i]) for i in ids], REFERENCES[views])


def make(split: str, number: int, textures: Textures) -> RigScene:
    """The scene of that number."""
    rng = np.random.default_rng([SEED, list(SPLITS).index(split), number])
    places = target_places(rng, TARGETS)
    cameras = [camera(*place) for place in [*CENTRES, *places]]
    k, r, t = (torch.stack([getattr(c, part) for c in cameras]).numpy() for part in ("k", "rotation", "translation"))
    reach = SIDE * float(np.abs(CENTRES).max())
    world = World(k, r, t, [(HEIGHT, WIDTH)] * len(cameras), 1 / FAR, reach)
    images, disparities = render(rng, world, textures, RECIPE)
    disparities = torch.stack(disparities).clamp(1 / FAR, 1 / NEAR)
    return RigScene(torch.stack([eight_bit(image) for image in images]), disparities.half(), places)


class Scenes:
    """The scenes of a split, kept in a folder; `textures` is a folder of photos to paint them
    with."""

    def __init__(self, folder: Path, textures: Path, split: str):
        self.folder, self.split, self.textures = folder / split, split, textures
        self.folder.mkdir(parents=True, exist_ok=True)

    def __len__(self) -> int:
        return SPLITS[self.split]

    def __getitem__(self, number: int) -> RigScene:
        path = self.folder / f"{number:04}.pt"
        if not path.exists():
            if isinstance(self.textures, Path):
                folder, self.textures = self.textures, Textures(self.textures)
                if not self.textures.photos:  # other textures would give other scenes under the same names
                    raise FileNotFoundError(f"{folder}: expected a folder of photos to paint scenes with")
            scene = make(self.split, number, self.textures)
            put(path, lambda temporary: torch.save(vars(scene), temporary))
        return RigScene(**torch.load(path, weights_only=True))


def main() -> None:
    """Make all scenes: python -m liveview_ref.paper.data.scenes FOLDER TEXTURES"""
    folder, textures = map(Path, sys.argv[1:])
    for split in SPLITS:
        scenes = Scenes(folder, textures, split)
        for number in range(len(scenes)):
            scenes[number]
            print(split, number, flush=True)


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
