"""Held-out photos and the views to render them from, listed in training configs ("validation") and
configs/evaluation.json: {"path", "width" (null: the photo's own), "targets", "heldout", "pool",
"near", "far"}."""

from pathlib import Path
from typing import NamedTuple

import torch.nn.functional as F
from torch import Tensor

from ..reference.liveview import Camera
from ..reference.views import choose_views
from .scene import Scene, open_scene

BORDER = 16  # pixels on each side, outside all scores
INNER = (..., slice(BORDER, -BORDER), slice(BORDER, -BORDER))


def resized(image: Tensor, width: int) -> Tensor:
    """[3, H, W] uint8 -> float in [0, 1] at this width, antialiased."""
    height = round(image.shape[1] * width / image.shape[2])
    image = F.interpolate(image[None].float() / 255, (height, width), mode="bilinear", antialias=True)
    return image[0].clamp(0, 1)


class Case(NamedTuple):
    """A held-out photo: the views to render it from, [3, Hs, Ws] in [0, 1], nearest first; its
    camera and the truth."""

    sources: list[Tensor]
    cameras: list[Camera]
    target: Camera
    truth: Tensor
    near: float
    far: float
    views: list[str]  # names of the photos


def targets_of(scene: Scene, spec: dict) -> list[int]:
    """Photos to render: the spec's targets, or every `heldout`-th."""
    return spec.get("targets") or list(range(0, len(scene.names), spec["heldout"]))


def pool_of(scene: Scene, spec: dict) -> list[int]:
    """Photos from which targets may be rendered: all but every `heldout`-th photo, or
    but all targets."""
    every = range(0, len(scene.names), spec["heldout"]) if spec.get("heldout") else spec["targets"]
    return [i for i in spec.get("pool", range(len(scene.names))) if i not in every]


def case_of(scene: Scene, spec: dict, t: int, views: int) -> Case:
    """The case of target t, with the nearest views of its pool."""
    pool = pool_of(scene, spec)
    width = spec["width"] or scene.cameras[t].width
    truth = resized(scene.image_u8(t), width)
    target = scene.cameras[t].with_size_scaled(width, truth.shape[1])
    ids = [pool[i] for i in choose_views([scene.cameras[i] for i in pool], target, views)]
    sources = [resized(scene.image_u8(i), width) for i in ids]
    cameras = [scene.cameras[i].with_size_scaled(width, s.shape[1]) for i, s in zip(ids, sources, strict=True)]
    near = spec.get("near") or min(scene.bounds[i][0] for i in ids)
    far = spec.get("far") or max(scene.bounds[i][1] for i in ids)
    return Case(sources, cameras, target, truth, float(near), float(far), [scene.names[i] for i in ids])


def cases(specs: list[dict], data: Path, views: int):
    """The case of each held-out photo of the specs."""
    for spec in specs:
        scene = open_scene(data / spec["path"])
        for t in targets_of(scene, spec):
            yield case_of(scene, spec, t, views)
