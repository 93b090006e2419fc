"""The stages as functions of plain arrays, in either precision: what the parity suite holds Rust against.

Each stage reads its inputs from `data` (numpy arrays, as `liveview dump` and parity/generate.py write them) and
returns its outputs by name.

`view{i}.image` [h, w, 3] float32; `k`, `rotation` [3, 3] and `translation` [3] float64 of `view{i}` and `target`;
`target.size` (width, height); `disparities` [D] float64 of planes, or `cell_maps` [L, h, w] float32 of guided layers,
with the steps of the coarse pass: `coarse.disparities` [D], `costs`, `agreed` [D, h/2, w/2], `coarse` [h/2, w/2],
`fine_layers`, `fine_costs` [D, h, w], `fine` [h, w]; `maps` [L, H8, W8]; `colour` (the HWV) [L, 3V, H8, W8];
`coverage`, `logits` [L, V, H8, W8]; `alpha` [L, H8, W8]; `rgb` [L, 3, H8, W8].
"""

import numpy as np
import torch
from torch import Tensor

from . import guide
from .blend import blend
from .camera import Camera
from .composite import composite
from .cost import layer_costs
from .layers import CELL, padded_size, upsample_maps
from .render import planes_over, view_distances, warp_views
from .semiglobal import semi_global
from .sweep import plane_homography

Arrays = dict[str, np.ndarray]
SCALED = (
    "homography",
    "coarse",
    "fine_layers",
    "fine",
    "range",
    "cell_maps",
    "maps",
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
    return {"maps": upsample_maps(tensor(data, "cell_maps", dtype)).numpy()}


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


def planes_of_search(data: Arrays, costs: np.ndarray, dtype: torch.dtype) -> Tensor:
    """The planes of the first search as maps [D, h, w]: the float32 numbers that Rust and torch both search through."""
    disparities = tensor(data, "coarse.disparities", torch.float32).to(dtype)
    return disparities[:, None, None].expand(costs.shape)


def costs(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Windowed variance on the planes of the first search."""
    if "coarse.disparities" not in data:
        return {}
    views, target = cameras_of(data)
    height, width = padded_size(target.height, target.width)
    shape = (len(data["coarse.disparities"]), height // guide.COARSE, width // guide.COARSE)
    planes = planes_of_search(data, np.empty(shape), dtype)
    found = layer_costs(images_of(data, dtype), views, target, planes, guide.COARSE, guide.WINDOWS[0])
    return {"costs": found.numpy()}


def agreed(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The costs made to agree along rows and columns."""
    return {"agreed": semi_global(tensor(data, "costs", dtype)).numpy()} if "costs" in data else {}


def coarse(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The disparity that the first search finds."""
    if "agreed" not in data:
        return {}
    found = guide.winner(tensor(data, "agreed", dtype), planes_of_search(data, data["agreed"], dtype))
    return {"coarse": found.numpy()}


def fine_layers(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The layers of the second search, from what the first found."""
    if "coarse" not in data:
        return {}
    step = float(data["coarse.disparities"][0] - data["coarse.disparities"][1])
    return {"fine_layers": guide.fine_layers(*guide.range_of(tensor(data, "coarse", dtype), step / 2)).numpy()}


def fine_costs(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Windowed variance on the layers of the second search."""
    if "fine_layers" not in data:
        return {}
    views, target = cameras_of(data)
    layers = tensor(data, "fine_layers", dtype)
    found = layer_costs(images_of(data, dtype), views, target, layers, CELL, guide.WINDOWS[1])
    return {"fine_costs": found.numpy()}


def fine(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The disparity that the second search finds."""
    if "fine_costs" not in data:
        return {}
    return {"fine": guide.winner(tensor(data, "fine_costs", dtype), tensor(data, "fine_layers", dtype)).numpy()}


def ranges(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Nearest, surface and farthest disparity of each cell [3, h, w]; the layers that divide that range [L, h, w]."""
    if "fine" not in data:
        return {}
    found = guide.range_of(tensor(data, "fine", dtype))
    divided = guide.guided_maps(*found, len(data["cell_maps"]))
    return {"range": torch.stack(found).numpy(), "cell_maps": divided.numpy()}


def best_layer(data: Arrays) -> np.ndarray:
    """Index of the layer of largest alpha (ties: the nearer) per pixel of the target [H, W]; -1 where all are 0."""
    width, height = data["target.size"]
    alpha = data["alpha"][:, :height, :width]
    return np.where(alpha.max(0) > 0, alpha.argmax(0), -1)


SEARCH = (costs, agreed, coarse, fine_layers, fine_costs, fine, ranges)
STAGES = (homography, *SEARCH, maps, warp, blended, composited)


def errors(found: np.ndarray, oracle: np.ndarray, name: str) -> tuple[float, float, tuple[int, ...]]:
    """(largest, mean, index of the largest) absolute error; relative to the oracle's largest element where SCALED."""
    difference = np.abs(found.astype(np.float64) - oracle)
    if not np.isfinite(difference).all():
        raise ValueError(f"{name}: not finite at {tuple(np.argwhere(~np.isfinite(difference))[0])}")
    if name in SCALED:
        difference = difference / np.abs(oracle).max()
    return float(difference.max()), float(difference.mean()), np.unravel_index(difference.argmax(), difference.shape)
