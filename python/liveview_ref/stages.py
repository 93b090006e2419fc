"""The stages as functions of plain arrays, in either precision: what the parity suite holds Rust against.

Each stage reads its inputs from `data` (numpy arrays, as `liveview dump` and parity/generate.py write them) and
returns its outputs by name.

`view{i}.image` [h, w, 3] float32; `k`, `rotation` [3, 3] and `translation` [3] float64 of `view{i}` and `target`;
`target.size` (width, height); `disparities` [D] float64 of planes, or `coarse_maps` [L, h, w] float32 of guided
layers, with `coarse.disparities` [D] and `coarse.winner` [h, w] of the coarse pass; `maps` [L, H8, W8]; `colour` (the
HWV) [L, 3V, H8, W8]; `coverage`, `logits` [L, V, H8, W8]; `alpha` [L, H8, W8]; `rgb` [L, 3, H8, W8].
"""

import numpy as np
import torch
from torch import Tensor

from . import guide
from .blend import blend
from .camera import Camera
from .composite import composite
from .layers import upsample_maps
from .render import planes_over, view_distances, warp_views
from .sweep import plane_homography

Arrays = dict[str, np.ndarray]
SCALED = (
    "homography",
    "coarse_maps",
    "maps",
    "range",
    "logits",
    "disparity",
)  # errors relative to the largest element of the oracle


def cameras_of(data: Arrays) -> tuple[list[Camera], Camera]:
    """The views' cameras, nearest first, and the target's."""

    def camera(name: str, width: int, height: int) -> Camera:
        parts = (torch.from_numpy(data[f"{name}.{x}"].astype(np.float64)) for x in ("k", "rotation", "translation"))
        return Camera(*parts, width, height)

    count = sum(name.endswith(".image") for name in data)
    images = [data[f"view{i}.image"] for i in range(count)]
    views = [camera(f"view{i}", image.shape[1], image.shape[0]) for i, image in enumerate(images)]
    return views, camera("target", *(int(x) for x in data["target.size"]))


def images_of(data: Arrays, dtype: torch.dtype) -> list[Tensor]:
    count = sum(name.endswith(".image") for name in data)
    return [torch.from_numpy(data[f"view{i}.image"]).to(dtype).permute(2, 0, 1).contiguous() for i in range(count)]


def tensor(data: Arrays, name: str, dtype: torch.dtype) -> Tensor:
    return torch.from_numpy(data[name]).to(dtype)


def homography(data: Arrays, dtype: torch.dtype) -> Arrays:
    """source_from_target of each view and plane [D, V, 3, 3]; float64 whatever the dtype."""
    views, target = cameras_of(data)
    if "disparities" not in data:
        return {}
    rows = [torch.stack([plane_homography(v, target, float(d)) for v in views]) for d in data["disparities"]]
    return {"homography": torch.stack(rows).numpy()}


def maps(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Disparity of each layer and pixel of the padded target [L, H8, W8]."""
    _, target = cameras_of(data)
    if "disparities" in data:
        return {"maps": planes_over(target, torch.from_numpy(data["disparities"]), dtype).numpy()}
    return {"maps": upsample_maps(tensor(data, "coarse_maps", dtype)).numpy()}


def warp(data: Arrays, dtype: torch.dtype) -> Arrays:
    views, target = cameras_of(data)
    colour, coverage = warp_views(images_of(data, dtype), views, target, tensor(data, "maps", dtype))
    return {"colour": colour.flatten(1, 2).numpy(), "coverage": coverage.numpy()}


def blended(data: Arrays, dtype: torch.dtype) -> Arrays:
    views, target = cameras_of(data)
    logits, coverage = tensor(data, "logits", dtype), tensor(data, "coverage", dtype)
    colour = tensor(data, "colour", dtype).unflatten(1, (len(views), 3))
    alpha, rgb = blend(logits, colour, coverage, view_distances(views, target))
    return {"alpha": alpha.numpy(), "rgb": rgb.numpy()}


def composited(data: Arrays, dtype: torch.dtype) -> Arrays:
    _, target = cameras_of(data)
    inputs = (tensor(data, x, dtype) for x in ("alpha", "rgb"))
    covered = torch.from_numpy(data["coverage"][-1] > 0).any(0)
    out = composite(*inputs, covered, tensor(data, "maps", dtype))
    crop = (..., slice(target.height), slice(target.width))
    parts = {"frame": out.rgb, "disparity": out.disparity, "transmittance": out.transmittance}
    return {name: value[crop].numpy() for name, value in parts.items()}


def costs(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Windowed variance of the coarse pass [D, h, w]."""
    if "coarse.disparities" not in data:
        return {}
    views, target = cameras_of(data)
    disparities = torch.from_numpy(data["coarse.disparities"])
    return {"costs": guide.plane_costs(images_of(data, dtype), views, target, disparities).numpy()}


def ranges(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Nearest and farthest disparity [2, h, w] from the winners [h, w]."""
    if "coarse.winner" not in data:
        return {}
    step = float(data["coarse.disparities"][0] - data["coarse.disparities"][1])
    return {"range": torch.stack(guide.range_of(tensor(data, "coarse.winner", dtype), step)).numpy()}


def guided(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The layers that divide each cell's range, as coarse maps [L, h, w], from the winners [h, w]."""
    if "coarse.winner" not in data:
        return {}
    nearest, farthest = torch.from_numpy(ranges(data, dtype)["range"])
    return {"coarse_maps": guide.guided_maps(nearest, farthest, len(data["coarse_maps"])).numpy()}


def best_layer(data: Arrays) -> np.ndarray:
    """Index of the layer of largest alpha (ties: the nearer) per pixel of the target [H, W]; -1 where all are 0."""
    width, height = data["target.size"]
    alpha = data["alpha"][:, :height, :width]
    return np.where(alpha.max(0) > 0, alpha.argmax(0), -1)


STAGES = (homography, costs, ranges, guided, maps, warp, blended, composited)


def errors(found: np.ndarray, oracle: np.ndarray, name: str) -> tuple[float, float, tuple[int, ...]]:
    """(largest, mean, index of the largest) absolute error; relative to the oracle's largest element where SCALED."""
    difference = np.abs(found.astype(np.float64) - oracle)
    if not np.isfinite(difference).all():
        raise ValueError(f"{name}: not finite at {tuple(np.argwhere(~np.isfinite(difference))[0])}")
    if name in SCALED:
        difference = difference / np.abs(oracle).max()
    return float(difference.max()), float(difference.mean()), np.unravel_index(difference.argmax(), difference.shape)
