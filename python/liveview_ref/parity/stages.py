"""The stages as functions of plain arrays, in either precision: the reference that the Rust crate
is compared with.

Each stage reads its inputs from `data` (numpy arrays, as `liveview dump` writes them) and
returns its outputs by name.

Photos and cameras are named as in rig_arrays.py. `disparities` [D] float64 of planes, or
`cell_maps` [L, h, w] float32 of guided layers, with the stages of the guided search:
`coarse_disparities` [D] float64, the planes searched; `costs`, `aggregated_costs`
[D, h/2, w/2], `coarse_disparity` [h/2, w/2]; `fine_layers`, `fine_costs` [D, h, w],
`fine_disparity` [h, w]; `range` [3, h, w]. `maps` [L, H8, W8]; `colour` (the HWV)
[L, 3V, H8, W8]; `coverage`, `logits` [L, V, H8, W8]; `alpha` [L, H8, W8]; `rgb` [L, 3, H8, W8];
`frame` [3, H, W]; `disparity`, `transmittance` [H, W]. `alpha_scale` [1] float64 if layers
compete; `gains` [V, 3] and `sharpening` [V] if the photos are corrected; `alpha_spacing` [1] and
`logit_shift` [L] float64 if opacity is per pixel of parallax.
`agreement`: the logits without a network.
"""

import numpy as np
import torch
from torch import Tensor

from ..reference.competing import best_layer as best_competing
from ..reference.competing import composite_competing
from ..reference.guided import COARSE_CELL, WINDOWS, guided_maps, layer_costs, range_of, semi_global, winner_takes_all
from ..reference.guided import fine_layers as layers_of_range
from ..reference.layers import CELL, plane_maps, upsample_maps, warp_views
from ..reference.liveview import PlaneSweep, UNet, blend, composite, padded_size, view_distances
from ..reference.spacing import logit_shift, shifted
from ..reference.surface.correction import CORRECTED_POWER, corrected
from ..reference.view_agreement import agreement_logits
from ..rig_arrays import Arrays, cameras_of, images_of

SCALED = (
    "homography",
    "coarse_disparity",
    "fine_layers",
    "fine_disparity",
    "range",
    "cell_maps",
    "maps",
    "logits",
    "disparity",
)  # errors relative to the largest element of the oracle


def tensor(data: Arrays, name: str, dtype: torch.dtype) -> Tensor:
    return torch.from_numpy(data[name]).to(dtype)


def homography(data: Arrays, dtype: torch.dtype) -> Arrays:
    """source_from_target of each view and plane [D, V, 3, 3], float64 for any dtype; of layers that
    are no planes, for the nearest and the farthest depth."""
    views, target = cameras_of(data)
    if "disparities" in data:
        disparities = data["disparities"]
    elif "shot.range" in data:
        disparities = 1 / data["shot.range"]
    else:
        return {}
    sweeps = [PlaneSweep.of(view, target) for view in views]
    rows = [torch.stack([sweep.source_from_target(float(d)) for sweep in sweeps]) for d in disparities]
    return {"homography": torch.stack(rows).numpy()}


def maps(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Disparity of each layer and pixel of the padded target [L, H8, W8]; surface layers are given
    as `maps`."""
    _, target = cameras_of(data)
    if "disparities" in data:
        return {"maps": plane_maps(target, torch.from_numpy(data["disparities"]), dtype).numpy()}
    if along_surface(data):
        return {}
    return {"maps": upsample_maps(tensor(data, "cell_maps", dtype)).numpy()}


def along_surface(data: Arrays) -> bool:
    """Whether the layers follow a surface: neither planes nor maps on cells."""
    return "disparities" not in data and "cell_maps" not in data


def warp(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Colour and coverage; not of surface layers, whose photos are corrected and whose occluded
    samples are removed (surface_stages.py)."""
    if along_surface(data):
        return {}
    views, target = cameras_of(data)
    images = images_of(data, dtype)
    if "gains" in data:
        images = corrected(images, tensor(data, "gains", dtype), tensor(data, "sharpening", dtype))
    colour, coverage = warp_views(images, views, target, tensor(data, "maps", dtype))
    return {"colour": colour.flatten(1, 2).numpy(), "coverage": coverage.numpy()}


def logits(net: UNet, hwv: np.ndarray, dtype: torch.dtype) -> np.ndarray:
    """The network on an HWV [n, 3V, H8, W8], layer by layer."""
    with torch.no_grad():
        return torch.cat([net.to(dtype)(torch.from_numpy(x[None]).to(dtype)) for x in hwv]).numpy()


def agreement(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The logits without a network, from the warped colours."""
    return {"agreement": agreement_logits(tensor(data, "colour", dtype).unflatten(1, (-1, 3))).numpy()}


def spacing(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The value added to logit 0 of planes whose opacity is per pixel of parallax [L]; float64, as
    cameras are."""
    if "alpha_spacing" not in data:
        return {}
    disparities = torch.from_numpy(data["disparities"])
    return {"logit_shift": logit_shift(*cameras_of(data), disparities, float(data["alpha_spacing"][0])).numpy()}


def blended(data: Arrays, dtype: torch.dtype) -> Arrays:
    views, target = cameras_of(data)
    logits, coverage = tensor(data, "logits", dtype), tensor(data, "coverage", dtype)
    colour = tensor(data, "colour", dtype).unflatten(1, (len(views), 3))
    power = CORRECTED_POWER if "gains" in data else 1.0
    if "logit_shift" in data:
        logits = shifted(logits, torch.from_numpy(data["logit_shift"]))
    alpha, rgb = blend(logits, colour, coverage, view_distances(views, target), power)
    return {"alpha": alpha.numpy(), "rgb": rgb.numpy()}


def composited(data: Arrays, dtype: torch.dtype) -> Arrays:
    _, target = cameras_of(data)
    alpha, rgb, maps = (tensor(data, x, dtype) for x in ("alpha", "rgb", "maps"))
    covered = torch.from_numpy(data["coverage"] > 0).any(1)
    if "alpha_scale" in data:
        logit = tensor(data, "logits", dtype)[:, 0]
        out = composite_competing(logit, rgb, covered, maps, float(data["alpha_scale"][0]))
    else:
        out = composite(alpha, rgb, covered[-1], maps)
    crop = (..., slice(target.height), slice(target.width))
    parts = {"frame": out.rgb, "disparity": out.disparity, "transmittance": out.transmittance}
    return {name: value[crop].numpy() for name, value in parts.items()}


def planes_of_search(data: Arrays, shape: tuple[int, ...], dtype: torch.dtype) -> Tensor:
    """The planes of the first search as maps of this shape, rounded to float32 as
    Rust searches them."""
    disparities = tensor(data, "coarse_disparities", torch.float32).to(dtype)
    return disparities[:, None, None].expand(shape)


def costs(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Windowed variance on the planes of the first search."""
    if "coarse_disparities" not in data:
        return {}
    views, target = cameras_of(data)
    height, width = padded_size(target.height, target.width)
    shape = (len(data["coarse_disparities"]), height // COARSE_CELL, width // COARSE_CELL)
    planes = planes_of_search(data, shape, dtype)
    found = layer_costs(images_of(data, dtype), views, target, planes, COARSE_CELL, WINDOWS[0])
    return {"costs": found.numpy()}


def aggregated_costs(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The costs aggregated along rows and columns."""
    return {"aggregated_costs": semi_global(tensor(data, "costs", dtype)).numpy()} if "costs" in data else {}


def coarse_disparity(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The disparity found by the first search."""
    if "aggregated_costs" not in data:
        return {}
    costs = tensor(data, "aggregated_costs", dtype)
    return {"coarse_disparity": winner_takes_all(costs, planes_of_search(data, costs.shape, dtype)).numpy()}


def fine_layers(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The layers of the second search, from the range found by the first."""
    if "coarse_disparity" not in data:
        return {}
    step = float(data["coarse_disparities"][0] - data["coarse_disparities"][1])
    found = range_of(tensor(data, "coarse_disparity", dtype), step / 2)
    return {"fine_layers": layers_of_range(found).numpy()}


def fine_costs(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Windowed variance on the layers of the second search."""
    if "fine_layers" not in data:
        return {}
    views, target = cameras_of(data)
    layers = tensor(data, "fine_layers", dtype)
    found = layer_costs(images_of(data, dtype), views, target, layers, CELL, WINDOWS[1])
    return {"fine_costs": found.numpy()}


def fine_disparity(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The disparity found by the second search."""
    if "fine_costs" not in data:
        return {}
    found = winner_takes_all(tensor(data, "fine_costs", dtype), tensor(data, "fine_layers", dtype))
    return {"fine_disparity": found.numpy()}


def ranges(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Nearest, surface and farthest disparity of each cell [3, h, w]; the layers that divide that
    range [L, h, w]."""
    if "fine_disparity" not in data:
        return {}
    found = range_of(tensor(data, "fine_disparity", dtype))
    divided = guided_maps(*found, len(data["cell_maps"]))
    return {"range": torch.stack(found).numpy(), "cell_maps": divided.numpy()}


def best_layer(data: Arrays) -> np.ndarray:
    """Index of the layer of largest alpha (ties: the nearer) per pixel of the target [H, W];
    -1 where all are 0. If layers compete, the layer of largest weight; -1 where no view
    covers any layer."""
    width, height = data["target.size"]
    if "alpha_scale" in data:
        logit, covered = torch.from_numpy(data["logits"][:, 0]), torch.from_numpy(data["coverage"] > 0).any(1)
        return best_competing(logit, covered)[:height, :width].numpy()
    alpha = data["alpha"][:, :height, :width]
    return np.where(alpha.max(0) > 0, alpha.argmax(0), -1)


SEARCH = (costs, aggregated_costs, coarse_disparity, fine_layers, fine_costs, fine_disparity, ranges)
STAGES = (homography, *SEARCH, maps, warp, spacing, blended, composited)


def errors(found: np.ndarray, oracle: np.ndarray, name: str) -> tuple[float, float, tuple[int, ...]]:
    """(largest, mean, index of the largest) absolute error; relative to the oracle's largest
    element where SCALED."""
    difference = np.abs(found.astype(np.float64) - oracle)
    if not np.isfinite(difference).all():
        raise ValueError(f"{name}: not finite at {tuple(np.argwhere(~np.isfinite(difference))[0])}")
    if name in SCALED:
        difference = difference / np.abs(oracle).max()
    return float(difference.max()), float(difference.mean()), np.unravel_index(difference.argmax(), difference.shape)
