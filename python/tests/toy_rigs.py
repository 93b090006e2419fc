"""Seeded rigs of photos and cameras, as arrays (rig_arrays.py), for the tests: photos of smooth
waves and noise, and photos of a scene with depth."""

import numpy as np
import torch
from torch import Tensor

from liveview_ref.reference.liveview import Camera
from liveview_ref.rig_arrays import Arrays, cameras_of, images_of

SIZE = (53, 38)  # width, height of the target: not multiples of 8
SOURCE = (61, 45)
PHOTO = 126, 70  # width, height of most photos: two tiles of the sweep, an even number of cells
PHOTOS = PHOTO, (95, 61), (64, 40), (131, 52)  # of the case with photos of different sizes
LARGE = 189, 105  # of the case that estimates exposure, from one pixel of 64
TARGET = 117, 66  # of the scene with depth
WALL, SQUARE = 6.0, 3.0  # depths of a slanted wall at its centre and of a square in front of it
SLANT = 0.15


def photo(rng: np.random.Generator) -> np.ndarray:
    """A photo of smooth waves and noise, [h, w, 3] float32 in [0, 1]."""
    width, height = SOURCE
    y, x = np.mgrid[:height, :width]
    waves = [np.sin(rng.uniform(0, 0.5) * x + rng.uniform(0, 0.5) * y + rng.uniform(0, 6)) for _ in range(9)]
    image = np.stack([sum(waves[c::3]) / 6 + 0.5 for c in range(3)], -1)
    return np.clip(image + rng.normal(0, 0.05, image.shape), 0, 1).astype(np.float32)


def turned(angles: np.ndarray) -> np.ndarray:
    """The rotation matrix of an axis times an angle in radians."""
    x, y, z = angles
    return torch.linalg.matrix_exp(torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=torch.float64)).numpy()


def rig(rng: np.random.Generator, views: int, kind: str) -> Arrays:
    """Photos and cameras of a case, nearest view first."""
    placed = []
    for _ in range(views):
        rotation, centre = turned(rng.normal(0, 0.06, 3)), rng.normal(0, 0.25, 3)
        k = np.array([[50 * rng.uniform(0.9, 1.1), 0, 30.5], [0, 50, 22.5], [0, 0, 1.0]])
        if kind == "rectified":
            rotation, centre, k = np.eye(3), np.array([rng.normal(0, 0.3), 0, 0]), np.diag([50.0, 50, 1]) + 0
            k[:2, 2] = 30.5, 22.5
        placed.append((rotation, centre, k))
    target = (
        turned(rng.normal(0, 0.03, 3)),
        rng.normal(0, 0.05, 3),
        np.array([[45.0, 0, 26], [0, 45, 19.5], [0, 0, 1]]),
    )
    if kind == "rectified":
        target = (np.eye(3), np.zeros(3), target[2])
    if kind == "coincident":
        target = (target[0], placed[0][1], target[2])
    if kind == "unseen":  # one view looks away, one is far to the side, and planes cross the cameras (w changes sign)
        placed[0] = (turned(np.array([0, np.pi, 0])), *placed[0][1:])
        placed[1] = (placed[1][0], np.array([40.0, 0, 0]), placed[1][2])
        placed[2] = (turned(np.array([0, 1.3, 0])), np.array([0, 0, 1.5]), placed[2][2])
    placed.sort(key=lambda p: float(np.linalg.norm(p[1] - target[1])))
    return arrays(placed, target, [photo(rng) for _ in placed], SIZE)


def rig_of(kind: str, views: int = 4) -> tuple[list[Tensor], list[Camera], Camera]:
    """Photos, their cameras and a target of a case."""
    data = rig(np.random.default_rng(7), views, kind)
    cameras, target = cameras_of(data)
    return images_of(data, torch.float64), cameras, target


def arrays(placed: list[tuple], target: tuple, photos: list[np.ndarray], size: tuple[int, int]) -> Arrays:
    """Of rotation, centre and K of each view and of the target."""
    data = {f"view{i}.image": image for i, image in enumerate(photos)} | {"target.size": np.array(size)}
    for name, (rotation, centre, k, *_) in [*((f"view{i}", p) for i, p in enumerate(placed)), ("target", target)]:
        data |= {f"{name}.rotation": rotation, f"{name}.translation": -rotation @ centre, f"{name}.k": k}
    return data


def colour(rng: np.random.Generator, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Texture [h, w, 3] of a surface: waves of all sizes."""
    found = np.zeros((*x.shape, 3))
    for _ in range(14):
        fx, fy = rng.normal(0, 5, 2)
        found += np.sin(fx * x + fy * y + rng.uniform(0, 6))[..., None] * rng.uniform(-0.1, 0.1, 3)
    return found + rng.uniform(0.4, 0.6, 3)


def photo_of_scene(
    k: np.ndarray, rotation: np.ndarray, centre: np.ndarray, size: tuple[int, int], seed: int
) -> np.ndarray:
    """The scene from a camera, [h, w, 3] float32 in [0, 1], by intersecting rays with the wall and
    the square."""
    columns, rows = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    rays = np.stack([columns, rows, np.ones_like(rows)], -1) @ (rotation.T @ np.linalg.inv(k)).T
    normal = np.array([-SLANT, 0, 1])
    along = (WALL - normal @ centre) / (rays @ normal)
    wall = centre + along[..., None] * rays
    square = centre + ((SQUARE - centre[2]) / rays[..., 2])[..., None] * rays
    inside = (np.abs(square[..., :2]) < [0.5, 0.4]).all(-1)
    textures = np.random.default_rng(seed), np.random.default_rng(seed + 1)
    behind, before = (colour(r, p[..., 0], p[..., 1]) for r, p in zip(textures, (wall, square), strict=True))
    return np.clip(np.where(inside[..., None], before, behind), 0, 1).astype(np.float32)


def surface_rig(rng: np.random.Generator, views: int, kind: str) -> Arrays:
    """Photos and cameras, nearest view first; kinds: scene, sizes, rectified,
    identical, flat, exposure, moving."""
    placed, photos = [], []
    for index in range(views):
        size = PHOTOS[index % len(PHOTOS)] if kind == "sizes" else LARGE if kind == "exposure" else PHOTO
        focal = size[0] * 0.9
        rotation, centre = turned(rng.normal(0, 0.02, 3)), rng.normal(0, 0.3, 3) * [1, 1, 0.3]
        k = np.array([[focal * rng.uniform(0.95, 1.05), 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1.0]])
        if kind == "rectified":
            rotation, centre, k[0, 0] = np.eye(3), np.array([0.2 * index, 0, 0]), focal
        if kind == "identical" and placed:
            rotation, centre, k, _ = placed[0]
        placed.append((rotation, centre, k, size))
    middle = turned(rng.normal(0, 0.01, 3)), rng.normal(0, 0.05, 3), np.array([[105.0, 0, 58], [0, 105, 33], [0, 0, 1]])
    if kind == "rectified":
        middle = np.eye(3), np.array([0.1, 0, 0]), middle[2]
    placed.sort(key=lambda p: float(np.linalg.norm(p[1] - middle[1])))
    seed = int(rng.integers(1 << 30))
    for index, (rotation, centre, k, size) in enumerate(placed):
        image = photo_of_scene(k, rotation, centre, size, seed)
        image = image + rng.normal(0, 0.004, image.shape)
        if kind == "exposure":
            image = image * (1 - 0.06 * index) ** np.array([1, 2, 0.5])
        if kind == "moving":  # most of it is elsewhere in every photo, and nothing confirms it
            left = slice(0, 9 * size[0] // 10)
            image[:, left] = np.roll(image, 11 * index, axis=index % 2)[:, left]
        image = np.full_like(image, 0.5) if kind == "flat" else np.clip(image, 0, 1)
        photos.append(image.astype(np.float32))
    return arrays(placed, middle, photos, TARGET)
