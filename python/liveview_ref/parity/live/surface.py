"""Surface layers on your own scene: the search of the photos' depth, and the stages at the target.

Beside the arrays of surface_stages.py, of photo i of the shot: `search{i}.NAME` of its search, and
`search{i}.neighbours`, views of the scene. `surface.corrected` [2]: exposure, sharpness.
"""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import torch
from torch import Tensor

from ...reference.guided import median3
from ...reference.layers import warp_maps
from ...reference.surface.aggregate import aggregate
from ...reference.surface.anchored_depth import LARGER_CELL, SMALL_CELL
from ...reference.surface.correction import corrected
from ...reference.surface.photo_depth import planes_of
from ...reference.surface.photo_sweep import Candidates, Grid, costs, has_many_planes, tile_ranges
from ...reference.surface.render import hide
from ...reference.surface.target_surface import OCCLUSION_MARGIN, Surface, seen
from ...rig_arrays import Arrays, cameras_of
from .. import surface_stages as stages
from ..surface_cases import kind_of
from .compared import Compared
from .scene import exact, neighbours_of

IN_SCENE_UNITS = "anchor", "nearer", "splat", "filled", "surface", "layers"  # relative to the largest
LIKE = {
    "half_ranges": "starts",
    "coarse_ranges": "starts",
    "coarse_found": "half_found",
    "larger_costs": "coarse_costs",
    "larger_found": "half_found",
    "anchored_found": "half_found",
    "anchored_index": "half_index",
    "colour": "hidden_colour",
    "coverage": "hidden_coverage",
}
BOTH = torch.float64, torch.float32


def with_photos(data: Arrays, views: list[int]) -> Arrays:
    """The dump with these views of the scene as the photos, and the range that was searched."""
    found = {name: value for name, value in data.items() if not name.startswith(("view", "photo"))}
    for i, v in enumerate(views):
        found |= {f"view{i}.{part}": data[f"scene.{part}"][v] for part in ("k", "rotation", "translation")}
        found[f"view{i}.image"] = data[f"photo{v}.colours"]
    return found | {"range": data["surface.range"]}


def photos_of(data: Arrays) -> list[int]:
    return [int(view) for view in data["shot.photos"]]


def compared(stage: stages.Stage, data: Arrays) -> Iterator[Compared]:
    """The outputs of a stage from the arrays of the dump."""
    oracle, single = (stage(data, dtype) for dtype in BOTH)
    for name, value in oracle.items():
        kind = kind_of(name)
        like = LIKE.get(kind, kind)
        found = data[name], value, single[name]
        yield Compared.of(kind, found, f"surface {like}", scaled=kind in IN_SCENE_UNITS)


def search(data: Arrays, photos: int | None = None) -> Iterator[Compared]:
    """The search of each photo's depth, or of the first ones', stage by stage; the same stages of
    all photos are one row."""
    rows: dict[str, Compared] = {}
    for i, view in list(enumerate(photos_of(data)))[:photos]:
        for row in search_of(data, i, view):
            rows[row.name] = rows[row.name].joined(row) if row.name in rows else row
    yield from rows.values()


def search_of(data: Arrays, i: int, view: int) -> Iterator[Compared]:
    around = neighbours_of(data, view)
    yield exact("neighbours", data[f"search{i}.neighbours"], around)
    if not around:
        return
    own = with_photos(data, [view, *around])
    own |= {name.split(".", 1)[1]: value for name, value in data.items() if name.startswith(f"search{i}.")}
    cameras, _ = cameras_of(own)
    grid, pixel = planes_of(cameras[0], cameras[1:], *(float(x) for x in own["range"]))
    yield exact("count", own["count"], grid.count)
    yield Compared.of("pixel", (data["pixel"][i], np.float64(pixel), np.float64(pixel)), "maps", scaled=True)
    own["pixel"] = data["pixel"][i : i + 1]
    for which, member in enumerate([view, *around]):
        yield from small_map(data, own, which, member)
    for stage in (stages.half_ranges, stages.half_costs, stages.half_found, stages.half_index):
        yield from compared(stage, own)
    yield from compared(stages.coarse_confirmations, own)
    for stage in (stages.anchors, stages.anchored_costs, anchored_found, anchored_index):
        yield from compared(stage, own)
    own["half_index"] = own["anchored_index"]
    for stage in (stages.starts, stages.fine_costs, stages.fine_found, stages.fine_index):
        yield from compared(stage, own)
    fine = stages.fine_grid(own)
    both = [fine.disparity(stages.tensor(own, "fine_index", dtype)).numpy() for dtype in BOTH]
    yield of_index("depth", fine, data[f"depth{i}"], *both)


def of_index(name: str, grid: Grid, *found: np.ndarray) -> Compared:
    """The disparities of indices of a grid, in units of its nearest."""
    return Compared.of(name, tuple(one.astype(np.float64) / grid.nearest for one in found), "surface disparity")


def anchored_found(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The second aggregation of the first search."""
    found = stages.half_found(data | {"half_costs": data["anchored_costs"]}, dtype)
    return {"anchored_found": found["half_found"]}


def anchored_index(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Its median, where the first result is not kept."""
    median, first = (median3(stages.tensor(data, "anchored_found", dtype)), stages.tensor(data, "half_index", dtype))
    return {"anchored_index": torch.where(torch.from_numpy(data["kept"]) > 0, first, median).numpy()}


def small_map(data: Arrays, search: Arrays, which: int, view: int) -> Iterator[Compared]:
    """The map of a photo of the group at the small size, as the first search of a photo but on
    larger cells, among its own neighbours."""
    near, far = (float(x) for x in search["range"])
    around = neighbours_of(data, view)
    yield exact("neighbours", search[f"coarse_neighbours{which}"], around)
    photos = search | with_photos(data, [view, *around])
    camera, *others = cameras_of(photos)[0]
    grid, pixel = planes_of(camera, others, near, far, SMALL_CELL)
    pixels = search["coarse_pixel"][which], np.float64(pixel), np.float64(pixel)
    yield Compared.of("pixel", pixels, "maps", scaled=True)
    if has_many_planes(grid):
        larger, _ = planes_of(camera, others, near, far, LARGER_CELL)
        yield from cell_search(photos, "larger", which, LARGER_CELL, larger)
        yield from compared(partial(coarse_ranges, which, grid), photos)
    yield from cell_search(photos, "coarse", which, SMALL_CELL, grid)


def cell_search(data: Arrays, name: str, which: int, cell: int, grid: Grid) -> Iterator[Compared]:
    """A search on cells of `cell` pixels a side: costs, what their aggregation finds, and the
    depth."""
    yield from compared(partial(cell_stages, name, which, cell, grid), data)
    found = (median3(stages.tensor(data, f"{name}_found{which}", dtype)) for dtype in BOTH)
    yield of_index(name, grid, data[f"{name}{which}"], *(grid.disparity(index).numpy() for index in found))


def coarse_ranges(which: int, grid: Grid, data: Arrays, dtype: torch.dtype) -> Arrays:
    size = stages.photos(data, dtype, SMALL_CELL)[0][0].shape[1:]
    found = tile_ranges(stages.tensor(data, f"larger{which}", dtype), grid, size)
    return {f"coarse_ranges{which}": found.numpy()}


def cell_stages(name: str, which: int, cell: int, grid: Grid, data: Arrays, dtype: torch.dtype) -> Arrays:
    """Costs, and what their aggregation finds."""
    (image, camera), *around = stages.photos(data, dtype, cell)
    candidates = Candidates.all(grid, *image.shape[1:])
    ranges = data.get(f"{name}_ranges{which}")
    ranges = None if ranges is None else torch.from_numpy(ranges.astype(np.int64))
    volume = costs(image, camera, around, grid, candidates, cell, ranges)
    found = aggregate(stages.tensor(data, f"{name}_costs{which}", torch.int64).permute(2, 0, 1), image, candidates)
    outputs = {"costs": volume.permute(1, 2, 0), "found": found}
    return {f"{name}_{of}{which}": output.numpy() for of, output in outputs.items()}


def at_target(data: Arrays) -> Iterator[Compared]:
    """From the photos' depth to the layers, their warp and occlusion."""
    views = len(cameras_of(data)[0])
    all_ = with_photos(data, photos_of(data))
    first = with_photos(data, photos_of(data)[:views])  # those to render from
    exposure, sharpness = (bool(yes) for yes in data["surface.corrected"])
    first["gains"] = data["gains"][:views]
    steps: list[tuple[stages.Stage, Arrays]] = [(stage, all_) for stage in stages.CONFIRMATION]
    steps += [(stages.exposures, all_)] if exposure else []
    steps += [(stages.sharpness, first)] if sharpness else []
    for stage, arrays in (*steps, (stages.splatted, all_), (stages.holes, all_), (the_surface, all_)):
        yield from joined(compared(stage, arrays))
    count, surface = len(data["maps"]), {dtype: stages.tensor(data, "surface", dtype) for dtype in BOTH}
    layers = [Surface(surface[dtype], 0, 0).layers(count).numpy() for dtype in BOTH]
    yield Compared.of("layers", (data["maps"], *layers), "maps", scaled=True)
    yield from compared(warped(stages.target_pixel(all_)), first)


def joined(rows: Iterator[Compared]) -> Iterator[Compared]:
    """Rows of one name as one."""
    found: dict[str, Compared] = {}
    for row in rows:
        found[row.name] = found[row.name].joined(row) if row.name in found else row
    yield from found.values()


def the_surface(data: Arrays, dtype: torch.dtype) -> Arrays:
    return {"surface": stages.surfaces(data, dtype)["surface"]}


def warped(pixel: float) -> Callable[[Arrays, torch.dtype], Arrays]:
    """The stage that warps the corrected photos onto the layers, without the samples that the views
    do not see; `pixel` is the disparity worth one pixel at the target."""

    def stage(data: Arrays, dtype: torch.dtype) -> Arrays:
        views, (_, target) = stages.surface_views(data, dtype), cameras_of(data)
        amounts = stages.tensor(data, "sharpening", dtype)
        photos = corrected([v.image for v in views], torch.stack([v.gains for v in views]), amounts)

        def layer(map_: Tensor) -> tuple[Tensor, Tensor]:
            both = [warp_maps(p, v.camera, target, map_[None]) for p, v in zip(photos, views, strict=True)]
            colour, coverage = (torch.cat(x) for x in zip(*both, strict=True))
            sees = seen(views, target, map_, OCCLUSION_MARGIN * pixel)
            return hide(sees, colour, coverage)[:2]

        colour, coverage = zip(*(layer(map_) for map_ in stages.tensor(data, "maps", dtype)), strict=True)
        return {"colour": torch.stack(colour).flatten(1, 2).numpy(), "coverage": torch.stack(coverage).numpy()}

    return stage
