"""Training examples: a target crop, its views warped onto layers, and the inputs of the loss."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..reference.guided import guided_maps, guided_search
from ..reference.layers import upsample_maps, warp_views
from ..reference.liveview import PlaneSweep, uniform_disparities, view_distances
from ..reference.views import choose_views, looking_the_same_way
from .procedural.scene import random_scene
from .procedural.textures import Textures
from .scene import Scene, open_scene


@dataclass
class Example:
    """hwv [L, 3V, H, W] float16, coverage [L, V, H, W] float16, maps [L, H, W], distances [V],
    target [3, H, W], disparity [H, W] (NaN where unknown); parallax: pixels of motion per unit of
    disparity in the farthest view."""

    hwv: Tensor
    coverage: Tensor
    maps: Tensor
    distances: Tensor
    target: Tensor
    disparity: Tensor
    parallax: float


class RealScene:
    """A folder of posed photos for training, with images resampled once to the given widths. The V
    views of a target are drawn from its nearest V to V + reach - 1 views ("reach" of the spec)."""

    def __init__(self, root: Path, spec: dict, views: int):
        scene: Scene = open_scene(root / spec["path"], spec.get("cameras", "cameras.txt"))
        self.near, self.far, self.reach = spec.get("near"), spec.get("far"), spec["reach"]
        self.bounds, self.sizes = scene.bounds, []
        self.targets = [t for t, c in enumerate(scene.cameras) if len(looking_the_same_way(scene.cameras, c)) > views]
        self.weight = float(spec["weight"]) if self.targets else 0.0  # 0 if no target has enough views around it
        for width in spec["widths"]:
            images, cameras = [], []
            for i, camera in enumerate(scene.cameras):
                height = round(camera.height * width / camera.width)
                image = scene.image_u8(i)[None].float()
                image = F.interpolate(image, (height, width), mode="bilinear", antialias=True, align_corners=False)
                images.append(image[0].round().to(torch.uint8))
                cameras.append(camera.with_size_scaled(width, height))
            self.sizes.append((images, cameras))

    def draw(self, rng: np.random.Generator, views: int, size: tuple[int, int]):
        """(views, their cameras, target, its camera, near, far, disparity of the target or None) of
        a random crop of `size` (height, width)."""
        images, cameras = self.sizes[rng.integers(len(self.sizes))]
        t = int(rng.choice(self.targets))
        others = cameras[:t] + cameras[t + 1 :]
        count = min(len(looking_the_same_way(others, cameras[t])), views + int(rng.integers(0, self.reach)))
        near_by = choose_views(others, cameras[t], count)
        pick = sorted(rng.permutation(count)[:views])  # nearest first
        ids = [near_by[p] + (near_by[p] >= t) for p in pick]
        height, width = size
        left = int(rng.integers(0, cameras[t].width - width + 1))
        top = int(rng.integers(0, cameras[t].height - height + 1))
        target = images[t][:, top : top + height, left : left + width].float() / 255
        bounds = [self.bounds[i] for i in ids]
        near = self.near or min(b[0] for b in bounds)
        far = self.far or max(b[1] for b in bounds)
        sources = [images[i].float() / 255 for i in ids]
        return (
            sources,
            [cameras[i] for i in ids],
            target,
            cameras[t].with_window(left, top, width, height),
            near,
            far,
            None,
        )


def procedural(rng: np.random.Generator, views: int, size: tuple[int, int], textures: Textures):
    """A procedural scene, in the form of RealScene.draw."""
    s = random_scene(rng, views, size, textures)
    return s.views, s.cameras, s.target, s.target_camera, s.near, s.far, s.disparity


def make_example(rng: np.random.Generator, source, config: dict) -> Example:
    """Order the views, choose layers (guided layers or uniform planes) and warp."""
    views, cameras, truth, target, near, far, disparity = source
    order = sorted(range(len(views)), key=lambda i: float((cameras[i].centre - target.centre).norm()))
    views, cameras = [views[i] for i in order], [cameras[i] for i in order]
    near, far = near * np.exp(rng.uniform(-0.2, 0.05)), far * np.exp(rng.uniform(-0.05, 0.2))
    if rng.random() < config["guided"]:
        nearest, surface, farthest = guided_search(views, cameras, target, near, far)
        widen = np.exp(rng.uniform(-0.2, 0.4))
        middle, half = (nearest + farthest) / 2, (nearest - farthest) / 2 * widen
        count = int(rng.choice(config["guided_layers"]))
        maps = upsample_maps(guided_maps(middle + half, surface, (middle - half).clamp(min=0), count))
    else:
        planes = uniform_disparities(near, far, int(rng.choice(config["uniform_planes"])))
        maps = planes.float()[:, None, None].expand(-1, target.height, target.width).contiguous()
    colour, coverage = warp_views(views, cameras, target, maps)
    distances = view_distances(cameras, target).float()
    unknown = torch.full_like(maps[0], torch.nan)
    hwv = colour.flatten(1, 2).half()
    parallax = max(float(PlaneSweep.of(c, target).epipole[:2].norm()) for c in cameras)
    return Example(hwv, coverage.half(), maps, distances, truth, unknown if disparity is None else disparity, parallax)


def maker(queue, config: dict, data: Path, worker: int, start: int) -> None:
    """Put batches (lists of Examples) into the queue forever, in a separate process; batch n
    depends only on the seed and on n."""
    torch.set_num_threads(1)
    real = [RealScene(data, spec, config["views"]) for spec in config["real"]]
    weights = np.array([scene.weight for scene in real])
    textures = Textures(data / config["textures"])
    index = start * config["makers"] + worker
    while True:
        rng = np.random.default_rng([config["seed"], index])
        batch = []
        while len(batch) < config["batch"]:
            size = tuple(config["crop"])
            if rng.random() < config["procedural"]:
                source = procedural(rng, config["views"], size, textures)
            else:
                source = real[rng.choice(len(real), p=weights / weights.sum())].draw(rng, config["views"], size)
            batch.append(make_example(rng, source, config))
        queue.put(batch)
        index += config["makers"]
