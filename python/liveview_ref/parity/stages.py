"""The stages of a picture, and of the guided search: what Rust makes of the output of the stage
before, beside the reference.

`data` are the arrays of the package's `guided_search`, `render` and `render_scene`: `disparities`
[D] float64 of planes; of guided layers the `cell_maps` [L, h, w] and the stages of their search:
`coarse_disparities` [D] float64, `costs`, `aggregated_costs` [D, h/2, w/2], `coarse_disparity`
[h/2, w/2], `fine_layers`, `fine_costs` [D, h, w], `fine_disparity` [h, w], `range` [3, h, w].
`maps` [L, H8, W8]; `colour` (the HWV) [L, 3V, H8, W8]; `coverage`, `logits` [L, V, H8, W8];
`alpha` [L, H8, W8]; `rgb` [L, 3, H8, W8]; `frame` [3, H, W]; `disparity`, `transmittance`,
`best_layer` [H, W]. `alpha_scale` if layers compete; `gains` [V, 3] and `sharpening` [V] if photos
are corrected.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..extension import liveview
from ..reference.competing import best_layer as best_competing
from ..reference.competing import composite_competing
from ..reference.guided import COARSE_CELL, WINDOWS, guided_maps, layer_costs, range_of, semi_global, winner_takes_all
from ..reference.guided import fine_layers as layers_of_range
from ..reference.layers import CELL, plane_maps, upsample_maps, warp_views
from ..reference.liveview import (
    Camera,
    PlaneSweep,
    UNet,
    blend,
    composite,
    homography_warped_volume,
    padded_size,
    view_distances,
)
from ..reference.surface.correction import CORRECTED_POWER, corrected
from ..reference.view_agreement import agreement_logits
from ..rig_arrays import Arrays
from .compared import Compared, row, rows


class Rig(NamedTuple):
    """Photos [3, h, w] float32 with their cameras, nearest first, and the target."""

    images: list[Tensor]
    cameras: list[Camera]
    target: Camera


def homography(rig: Rig, disparities: np.ndarray) -> Compared:
    """source_from_target of each view and plane [D, V, 3, 3], float64 in both languages."""
    found = [
        [liveview._stages.source_from_target(camera, rig.target, float(d)) for camera in rig.cameras]
        for d in disparities
    ]
    sweeps = [PlaneSweep.of(camera, rig.target) for camera in rig.cameras]
    expected = [[sweep.source_from_target(float(d)).numpy() for sweep in sweeps] for d in disparities]
    return Compared.of("homography", (found, expected, expected), scaled=True)


def guided_search(data: Arrays, rig: Rig) -> Iterator[Compared]:
    """Two searches, the range that they find, and the layers that divide it."""
    height, width = (side // COARSE_CELL for side in padded_size(rig.target.height, rig.target.width))
    disparities = data["coarse_disparities"]
    planes = torch.from_numpy(disparities.astype(np.float32))[:, None, None].expand(-1, height, width)
    yield row("costs", data["costs"], layer_costs, *rig, planes, COARSE_CELL, WINDOWS[0])
    yield row("aggregated_costs", data["aggregated_costs"], semi_global, data["costs"])
    found = data["coarse_disparity"]
    yield row("coarse_disparity", found, winner_takes_all, data["aggregated_costs"], planes)
    margin = float(disparities[0] - disparities[1]) / 2
    yield row("fine_layers", data["fine_layers"], lambda map_: layers_of_range(range_of(map_, margin)), found)
    yield row("fine_costs", data["fine_costs"], layer_costs, *rig, data["fine_layers"], CELL, WINDOWS[1])
    found = data["fine_disparity"]
    yield row("fine_disparity", found, winner_takes_all, data["fine_costs"], data["fine_layers"])
    yield row("range", data["range"], lambda map_: torch.stack(range_of(map_)), found)
    count = len(data["cell_maps"])
    yield row("cell_maps", data["cell_maps"], lambda map_: guided_maps(*range_of(map_), count), found)


def warp(data: Arrays, rig: Rig) -> Iterator[Compared]:
    """Disparity of each layer and pixel of the padded target, and the photos on it. Surface layers,
    whose occluded samples are removed, are compared in surface.py."""
    if "cell_maps" in data:
        yield row("maps", data["maps"], upsample_maps, data["cell_maps"])
    else:
        planes = torch.from_numpy(data["disparities"])
        both = (plane_maps(rig.target, planes, dtype) for dtype in (torch.float64, torch.float32))
        yield Compared.of("maps", (data["maps"], *both), scaled=True)
    amounts = (data["gains"], data["sharpening"]) if "gains" in data else None

    def warped(images: list[Tensor], amounts: tuple[Tensor, Tensor] | None, maps: Tensor) -> tuple[Tensor, Tensor]:
        images = corrected(images, *amounts) if amounts else images
        if "cell_maps" in data:
            colour, coverage = warp_views(images, *rig[1:], maps)
        else:
            colour, coverage = homography_warped_volume(images, *rig[1:], torch.from_numpy(data["disparities"]))
        return colour.flatten(1, 2), coverage

    found = data["colour"], data["coverage"]
    yield from rows(("colour", "coverage"), found, warped, rig.images, amounts, data["maps"])


def logits(data: Arrays, net: UNet | None, entry: str = "logits") -> Compared:
    """The network's layer by layer, or those of the views' agreement."""
    if net is None:
        colour = torch.from_numpy(data["colour"]).unflatten(1, (-1, 3))
        return row("agreement", data["logits"], agreement_logits, colour, data["coverage"])

    def of_layers(hwv: Tensor) -> Tensor:
        with torch.no_grad():
            return torch.cat([net.to(hwv.dtype)(layer[None]) for layer in hwv])

    return row("logits", data["logits"], of_layers, data["colour"], entry=entry)


def picture(data: Arrays, rig: Rig) -> Iterator[Compared]:
    """From logits to the frame."""
    distances = view_distances(*rig[1:])
    power = CORRECTED_POWER if "gains" in data else 1.0

    def blended(logits: Tensor, colour: Tensor, coverage: Tensor) -> tuple[Tensor, Tensor]:
        return blend(logits, colour.unflatten(1, (-1, 3)), coverage, distances, power)

    found = data["alpha"], data["rgb"]
    yield from rows(("alpha", "rgb"), found, blended, data["logits"], data["colour"], data["coverage"])
    names = "frame", "disparity", "transmittance"
    arrays = (data[name] for name in ("logits", "alpha", "rgb", "coverage", "maps"))
    crop = (..., slice(rig.target.height), slice(rig.target.width))

    def composited(logits: Tensor, alpha: Tensor, rgb: Tensor, coverage: Tensor, maps: Tensor) -> list[Tensor]:
        covered = (coverage > 0).any(1)
        if "alpha_scale" in data:
            out = composite_competing(logits[:, 0], rgb, covered, maps, float(data["alpha_scale"]))
        else:
            out = composite(alpha, rgb, covered[-1], maps)
        return [part[crop] for part in (out.rgb, out.disparity, out.transmittance)]

    yield from rows(names, (data[name] for name in names), composited, *arrays)


def best_layer(data: Arrays) -> np.ndarray:
    """Index of the layer of largest alpha (ties: the nearer) per pixel of the target [H, W];
    -1 where all are 0. If layers compete, the layer of largest weight; -1 where no view
    covers any layer."""
    height, width = data["best_layer"].shape
    if "alpha_scale" in data:
        logit, covered = torch.from_numpy(data["logits"][:, 0]), torch.from_numpy(data["coverage"] > 0).any(1)
        return best_competing(logit, covered)[:height, :width].numpy()
    alpha = data["alpha"][:, :height, :width]
    return np.where(alpha.max(0) > 0, alpha.argmax(0), -1)
