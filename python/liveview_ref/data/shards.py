"""Training examples kept on disk: shards of photos (8 bit), cameras, and the surface if
it is known.

Photos are warped during training, so that an example can be used with any planes. A shard is
determined by its number, the seed and the recipe.
"""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..reference.layers import source_coordinates
from ..reference.liveview import Camera, PlaneSweep, padded_size
from ..reference.views import widest_parallax
from .examples import RealScene
from .procedural.scene import Recipe, random_scene
from .procedural.textures import Textures
from .visibility import partly_hidden, visibility


@dataclass
class Photos:
    """A target crop and its photos. views: V of [3, Hs, Ws] uint8, nearest first; target [3, H, W]
    uint8; disparity [H, W] of the target's surface (1/scene unit) and seen [V, H, W] uint8
    (visibility.py), None on real scenes; near and far in scene units. Training may narrow the range
    once; then it is kept (`keeps_range`)."""

    views: list[Tensor]
    cameras: list[Camera]
    target: Tensor
    camera: Camera
    near: float
    far: float
    disparity: Tensor | None
    seen: Tensor | None
    keeps_range: bool = False


def pack(p: Photos) -> dict:
    def plain(c: Camera) -> tuple:
        return c.k, c.rotation, c.translation, c.width, c.height

    known = None if p.disparity is None else (p.disparity, p.seen)
    return {"views": p.views, "cameras": [plain(c) for c in p.cameras], "target": p.target, "camera": plain(p.camera),
            "range": (p.near, p.far), "known": known}  # fmt: skip


def unpack(d: dict) -> Photos:
    cameras = [Camera(*c) for c in d["cameras"]]
    return Photos(d["views"], cameras, d["target"], Camera(*d["camera"]), *d["range"], *(d["known"] or (None, None)))


def eight_bit(image: Tensor) -> Tensor:
    return (image * 255).round().clamp(0, 255).to(torch.uint8)


def nearest_first(views, cameras: list[Camera], target: Camera, *others):
    order = sorted(range(len(views)), key=lambda i: float((cameras[i].centre - target.centre).norm()))
    return ([x[i] for i in order] for x in (views, cameras, *others))


def recipe_of(config: dict) -> Recipe:
    ranges = (tuple(config[key]) for key in ("parallax", "exposure", "things"))
    return Recipe(*ranges, *(config[key] for key in ("thin", "rooms", "phones")))


def made(rng: np.random.Generator, config: dict, textures: Textures) -> Photos:
    """A procedural scene; scenes with little occlusion are mostly drawn again."""
    size, recipe = tuple(config["crop"]), recipe_of(config)
    while True:
        s = random_scene(rng, config["views"], size, textures, recipe)
        target = s.target_camera
        views, cameras, maps = nearest_first(s.views, s.cameras, target, s.view_disparities)
        seen = visibility(s.disparity, target, maps, cameras)
        if float(partly_hidden(seen).float().mean()) > config["hidden"] or rng.random() < config["keep"]:
            views = [eight_bit(v) for v in views]
            return Photos(views, cameras, eight_bit(s.target), target, float(s.near), float(s.far), s.disparity, seen)


def cropped(rng: np.random.Generator, config: dict, scene: RealScene) -> Photos:
    """A crop of a real photo, with its views cropped to what the target can see."""
    for _ in range(20):  # views so far apart that they share hardly any points teach nothing
        sources, cameras, truth, target, near, far, _ = scene.draw(rng, config["views"], tuple(config["crop"]))
        size = padded_size(target.height, target.width)
        if widest_parallax(cameras, target, near, far, size) < config["most_parallax"]:
            break
    sources, cameras = nearest_first(sources, cameras, target)
    bounds = torch.tensor([1.1 / near, 0.9 / far], dtype=torch.float64)[:, None, None]
    views, cut = [], []
    for view, camera in zip(sources, cameras, strict=True):
        at, w = source_coordinates(PlaneSweep.of(camera, target), bounds.expand(-1, target.height, target.width))
        low, high = at.reshape(-1, 2).amin(0).floor() - 3, at.reshape(-1, 2).amax(0).ceil() + 3
        if float(w.min()) <= 0 or not bool(torch.isfinite(at).all()):  # partly behind the view: keep all of it
            low, high = torch.zeros(2), torch.tensor([camera.width, camera.height])
        left, top = (int(low[i].clamp(0, size - 8)) for i, size in enumerate((camera.width, camera.height)))
        right, bottom = (
            int(high[i].clamp(start + 8, size))
            for i, (start, size) in enumerate(((left, camera.width), (top, camera.height)))
        )
        views.append(eight_bit(view[:, top:bottom, left:right]).clone())
        cut.append(camera.with_window(left, top, right - left, bottom - top))
    return Photos(views, cut, eight_bit(truth), target, float(near), float(far), None, None)


# Fields of a config that determine the contents of a shard.
PHOTOS = ["views", "seed", "crop", "shard", "procedural", "textures", "real", "most_parallax"]
SCENES = ["parallax", "exposure", "things", "thin", "rooms", "phones", "hidden", "keep"]


class Shards:
    """Shards in a folder, made when first needed, from a training config."""

    def __init__(self, folder: Path, config: dict, data: Path):
        self.config, self.data = {key: config[key] for key in PHOTOS + SCENES}, data
        name = hashlib.sha256(json.dumps(self.config, sort_keys=True).encode()).hexdigest()[:12]
        self.folder = folder / name
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / "recipe.json").write_text(json.dumps(self.config, indent=1))
        self.sources = None

    def __getitem__(self, number: int) -> list[Photos]:
        path = self.folder / f"{number:05}.pt"
        if not path.exists():
            torch.save([pack(p) for p in self.make(number)], path.with_suffix(".tmp"))
            path.with_suffix(".tmp").rename(path)
        return [unpack(d) for d in torch.load(path, weights_only=True)]

    def make(self, number: int) -> list[Photos]:
        config = self.config
        if self.sources is None:
            real = [RealScene(self.data, spec, config["views"]) for spec in config["real"]]
            self.sources = real, Textures(self.data / config["textures"])
        real, textures = self.sources
        weights = np.array([scene.weight for scene in real])
        rng = np.random.default_rng([config["seed"], number])
        photos = []
        for _ in range(config["shard"]):
            if rng.random() < config["procedural"]:
                photos.append(made(rng, config, textures))
            else:
                photos.append(cropped(rng, config, real[rng.choice(len(real), p=weights / weights.sum())]))
        return photos
