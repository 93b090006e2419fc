"""Seeded rigs of photos and cameras, as arrays (rig_arrays.py), for the tests."""

import numpy as np
import torch

from ..rig_arrays import Arrays

SIZE = (53, 38)  # width, height of the target: not multiples of 8
SOURCE = (61, 45)


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
    data, placed = {}, []
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
    for name, (rotation, centre, k) in [*((f"view{i}", p) for i, p in enumerate(placed)), ("target", target)]:
        data |= {f"{name}.rotation": rotation, f"{name}.translation": -rotation @ centre, f"{name}.k": k}
    data |= {f"view{i}.image": photo(rng) for i in range(views)}
    return data | {"target.size": np.array(SIZE)}
