"""The stages of surface layers: what Rust makes of the output of the stage before, beside the
reference. The search of a photo's depth, and the surface at the target.

A view is a photo [3, h, w] float32 with its camera, a span the nearest and farthest depth.
"""

import math
from collections.abc import Generator, Iterator

import numpy as np
import torch
from torch import Tensor

from ..extension import liveview
from ..reference.guided import median3, shrink
from ..reference.liveview import Camera, padded_size, view_distances
from ..reference.surface.aggregate import aggregate
from ..reference.surface.anchored_depth import GROUP_PIXELS, LARGER_CELL, SMALL_CELL, Group, confirmed_by
from ..reference.surface.correction import exposure_gains, sharpening
from ..reference.surface.fusion import AGREEMENT, FUSED, ConfirmedDisparity, SurfaceView, confirmed, nearer_edges, splat
from ..reference.surface.photo_depth import (
    CELL,
    FINE_STEPS,
    LEAST_PLANES,
    MOST_PLANES,
    Anchors,
    PhotoDisparity,
    bands,
    pixel_of,
    planes_of,
)
from ..reference.surface.photo_sweep import Candidates, Grid, costs, has_many_planes, tile_ranges
from ..reference.surface.render import warp_seen
from ..reference.surface.target_surface import (
    OCCLUSION_MARGIN,
    Surface,
    fill_holes,
    surface,
)
from ..reference.views import widest_parallax
from ..rig_arrays import Arrays
from .compared import Compared, exact, row, rows

inner = liveview._stages
View = tuple[Tensor, Camera]
Span = tuple[float, float]
SURFACE = "surface {}"  # entry of the tolerance file


class CellSearch:
    """A search of a photo among others on cells of `cell` pixels a side."""

    def __init__(self, views: list[View], span: Span, grid: Grid, cell: int, starts: np.ndarray | None = None):
        """`grid` is the first search's; with `starts` it is the second, of a part of that."""
        self.views, self.cell, self.starts, self.ranges = views, cell, starts, None
        parts = 1 if starts is None else FINE_STEPS
        self.grid = grid if starts is None else grid.divided(parts)
        self.given = *span, grid.count, parts, cell, starts

    def shrunk(self, views: list[View]) -> list[View]:
        return [(shrink(image, self.cell) if self.cell > 1 else image, camera) for image, camera in views]

    def candidates(self, size: tuple[int, int]) -> Candidates:
        if self.starts is None:
            return Candidates.all(self.grid, *size)
        return Candidates.two(torch.from_numpy(self.starts.astype(np.int64)), *size)

    def tile_ranges(self, name: str, coarser: np.ndarray) -> Iterator[Compared]:
        """The planes of each tile, around what a search on larger cells found."""
        if has_many_planes(self.grid):
            size = self.shrunk(self.views[:1])[0][0].shape[1:]
            self.ranges = inner.tile_ranges(coarser, (*self.given, None), size)
            yield row(name, self.ranges, tile_ranges, coarser, self.grid, size, entry="surface starts")

    def costs(self, name: str, entry: str) -> Generator[Compared, None, np.ndarray]:
        """Those of the candidates that a cell has, 0 for the others."""

        def volume(views: list[View]) -> Tensor:
            (image, camera), *around = self.shrunk(views)
            candidates = self.candidates(image.shape[1:])
            ranges = None if self.ranges is None else torch.from_numpy(self.ranges.astype(np.int64))
            found = costs(image, camera, around, self.grid, candidates, self.cell, ranges)
            return torch.where(candidates.there, found, 0).permute(1, 2, 0)

        found = inner.costs(self.views[0], self.views[1:], (*self.given, self.ranges))
        there = self.candidates(found.shape[:2]).there.permute(1, 2, 0).numpy()
        found = np.where(there, found, np.uint16(0))
        yield row(name, found, volume, self.views, entry=entry)
        return found

    def found(
        self, name: str, volume: np.ndarray, entry: str = "surface half_found"
    ) -> Generator[Compared, None, np.ndarray]:
        """The index of each cell by aggregation of the costs."""

        def aggregated(volume: Tensor, views: list[View]) -> Tensor:
            (image, _) = self.shrunk(views)[0]
            return aggregate(volume.permute(2, 0, 1), image, self.candidates(image.shape[1:]))

        found = inner.aggregate(volume, self.views[0], (*self.given, None))
        yield row(name, found, aggregated, volume, self.views[:1], entry=entry)
        return found

    def median(self, name: str, found: np.ndarray) -> Generator[Compared, None, np.ndarray]:
        index = liveview.median3(found)
        yield row(name, index, median3, found, entry=SURFACE)
        return index

    def depth(self, name: str, disparity: np.ndarray, found: np.ndarray, index_of=median3) -> Compared:
        """The disparities of what the aggregation found, in units of the nearest."""

        def units(found: Tensor) -> np.ndarray:
            return self.grid.disparity(index_of(found)).numpy().astype(np.float64) / self.grid.nearest

        return row(name, disparity.astype(np.float64) / self.grid.nearest, units, found, entry="surface disparity")

    def disparity(self, index: np.ndarray) -> np.ndarray:
        return inner.disparity(index, (*self.given, None))


def first_search(search: CellSearch) -> Generator[Compared, None, tuple[np.ndarray, np.ndarray]]:
    """Costs and indices at half resolution."""
    volume = yield from search.costs("half_costs", SURFACE)
    found = yield from search.found("half_found", volume)
    return volume, (yield from search.median("half_index", found))


def small_map(views: list[View], span: Span) -> Generator[Compared, None, PhotoDisparity]:
    """The map of the first of these photos at the small size, searched among the others."""
    camera, *around = (camera for _, camera in views)
    grid, pixel = planes_of(camera, around, *span, SMALL_CELL)
    map_ = PhotoDisparity(*inner.small_map(views, *span))
    yield Compared.of("pixel", (map_.pixel, pixel, pixel), "maps", scaled=True)
    search = CellSearch(views, span, grid, SMALL_CELL)
    if has_many_planes(grid):
        first = CellSearch(views, span, planes_of(camera, around, *span, LARGER_CELL)[0], LARGER_CELL)
        volume = yield from first.costs("larger_costs", "surface coarse_costs")
        found = yield from first.found("larger_found", volume)
        larger = first.disparity(liveview.median3(found))
        yield first.depth("larger", larger, found)
        yield from search.tile_ranges("coarse_ranges", larger)
    volume = yield from search.costs("coarse_costs", SURFACE)
    found = yield from search.found("coarse_found", volume)
    yield search.depth("coarse", map_.disparity, found)
    return map_


def photo_search(groups: list[list[View]], span: Span, depth: PhotoDisparity) -> Iterator[Compared]:
    """The search of a photo's depth. `groups`: the photo and those that it is matched with, each
    with those that it is matched with itself; `depth`: what Rust found."""
    views = groups[0]
    cameras = [camera for _, camera in views]
    grid, pixel = planes_of(cameras[0], cameras[1:], *span)
    # The pixel is rounded.
    planes = math.ceil((1 / span[0] - 1 / span[1]) / depth.pixel * 2 / CELL * (1 - 1e-7)) + 1
    yield exact("count", min(max(planes, LEAST_PLANES), MOST_PLANES), grid.count)
    yield Compared.of("pixel", (depth.pixel, pixel, pixel), "maps", scaled=True)
    maps = []
    for group in groups:
        maps.append((yield from small_map(group, span)))
    search = CellSearch(views, span, grid, CELL)
    yield from search.tile_ranges("half_ranges", maps[0].disparity)
    volume, index = yield from first_search(search)

    sure = inner.group_confirmed(cameras, maps)
    members = list(zip((camera.shrunk(SMALL_CELL) for camera in cameras), maps, strict=True))
    for i, own in enumerate(members):
        others = members[:i] + members[i + 1 :]
        yield row("coarse_sure", sure[i] >= 0, confirmed_in_group, own, others, entry=SURFACE)
    kept, anchor = inner.anchors(cameras, maps, sure, (search.disparity(index), depth.pixel))

    def anchors(members: list, sure: list[Tensor], index: Tensor) -> Anchors:
        own = PhotoDisparity(grid.disparity(index), depth.pixel)
        return Group(members, sure).anchors(cameras[0].shrunk(CELL), own)

    yield from rows(("kept", "anchor"), (kept, anchor), anchors, members, sure, index, entry=SURFACE)
    anchored = inner.anchored_costs(volume, kept, anchor, (*search.given, None))

    def added(volume: Tensor, kept: Tensor, anchor: Tensor) -> Tensor:
        return Anchors(kept, anchor).added_to(volume.permute(2, 0, 1), grid).permute(1, 2, 0)

    yield row("anchored_costs", anchored, added, volume, kept, anchor, entry=SURFACE)
    found = yield from search.found("anchored_found", anchored)
    anchored = np.where(kept, index, liveview.median3(found))

    def again(kept: Tensor, index: Tensor, found: Tensor) -> Tensor:
        return torch.where(kept, index, median3(found))

    yield row("anchored_index", anchored, again, kept, index, found, entry="surface half_index")
    yield from second_search(views, span, grid, anchored, depth)


def second_search(
    views: list[View], span: Span, grid: Grid, index: np.ndarray, depth: PhotoDisparity
) -> Iterator[Compared]:
    """At full resolution, around the index that the first search found; `depth`: the result."""
    fine = grid.divided(FINE_STEPS)
    starts = inner.bands(index, FINE_STEPS, fine.count)
    yield row("starts", starts, bands, index, FINE_STEPS, fine.count, entry=SURFACE)
    search = CellSearch(views, span, grid, 1, starts)
    volume = yield from search.costs("fine_costs", SURFACE)
    found = yield from search.found("fine_found", volume, SURFACE)
    yield search.depth("depth", depth.disparity, (yield from search.median("fine_index", found)), lambda index: index)


def confirmed_in_group(own: tuple[Camera, PhotoDisparity], others: list[tuple[Camera, PhotoDisparity]]) -> Tensor:
    return confirmed_by(own, others, GROUP_PIXELS) >= 0


def surface_views(
    views: list[View], depths: list[ConfirmedDisparity], gains: np.ndarray | None = None
) -> list[SurfaceView]:
    """The photos with their confirmed depth; gains [V, 3] are 1 by default."""
    gains = torch.ones(len(views), 3) if gains is None else torch.from_numpy(gains)
    found = zip(views, depths, gains, strict=False)
    return [SurfaceView(image, camera, depth, gain) for (image, camera), depth, gain in found]


def target_pixel(views: list[View], target: Camera, span: Span) -> float:
    size = padded_size(target.height, target.width)
    return pixel_of(widest_parallax([camera for _, camera in views], target, *span, size), *span)


def confirmation(
    views: list[View], depths: list[PhotoDisparity], used: list[np.ndarray]
) -> Generator[Compared, None, list[ConfirmedDisparity]]:
    """What other photos confirm of each photo's depth, before and after edges move to the nearer
    side. `used`: of the first photos, the result as Rust used it."""
    cameras, results = [camera for _, camera in views], []

    def confirmed_of(maps: list[PhotoDisparity], i: int) -> np.ndarray:
        return liveview.confirmed(i, list(zip(cameras, maps, strict=True)))

    sure = [confirmed_of(depths, i) for i in range(len(views))]
    for i, one in enumerate(sure):
        yield row("confirmed", one, confirmed, i, list(zip(cameras, depths, strict=True)), entry=SURFACE)
    moved = [inner.nearer_edges(i, views, depths, one) for i, one in enumerate(sure)]
    nearer = [PhotoDisparity(map_, depth.pixel) for map_, depth in zip(moved, depths, strict=True)]
    for i in range(len(views)):
        own = used[i] if i < len(used) else np.where(confirmed_of(nearer, i), moved[i], np.float32(-1))
        results.append(ConfirmedDisparity(own, depths[i].pixel))
    nearer = [
        PhotoDisparity(np.where(own >= 0, own, map_), pixel) for (own, pixel), map_ in zip(results, moved, strict=True)
    ]
    for i, one in enumerate(sure):
        yield row("nearer", nearer[i].disparity, nearer_edges, i, views, depths, one, entry=SURFACE)
    for i, (own, _) in enumerate(results):
        yield row("sure", own >= 0, confirmed, i, list(zip(cameras, nearer, strict=True)), entry=SURFACE)
    return results


def at_target(views: list[View], target: Camera, span: Span, data: Arrays) -> Generator[Compared, None, tuple]:
    """From the photos' depth to the layers, their warp and occlusion; `data` as `render_scene` of
    the package returns it. Also returns the photos with their depths, and the splat."""
    pixels, count = data["pixel"], len(data["gains"])
    depths = [PhotoDisparity(data[f"depth{i}"], float(pixel)) for i, pixel in enumerate(pixels)]
    known = yield from confirmation(views, depths, [data[f"used{i}"] for i in range(count)])
    distances = view_distances([camera for _, camera in views], target)
    photos = surface_views(views, known)
    gains = np.concatenate([data["gains"], liveview.exposure_gains(photos, distances)[count:]])
    yield row("gains", gains, exposure_gains, photos, distances, entry=SURFACE)
    photos = surface_views(views, known, gains)
    yield row("sharpening", data["sharpening"], sharpening, photos[:count], entry=SURFACE)
    size, pixel = padded_size(target.height, target.width), target_pixel(views, target, span)

    def splatted(photos: list[SurfaceView]) -> Tensor:
        maps = [(photo.camera, photo.confirmed.disparity) for photo in photos]
        return splat(maps, target, *size, AGREEMENT * pixel, FUSED * pixel)

    fused = inner.splat(photos, target, inner.pixel_of(photos, target, *span))
    yield row("splat", fused, splatted, photos, entry=SURFACE)
    yield row("filled", liveview.fill_holes(fused), fill_holes, fused, entry=SURFACE)
    found = data["surface"]
    yield row("surface", found, lambda photos: surface(photos, target, *span).disparity, photos, entry=SURFACE)
    layers = data["maps"]
    yield row("layers", layers, lambda map_: Surface(map_, 0, 0).layers(len(layers)), found, entry="maps")

    def warped(photos: list[SurfaceView], amounts: Tensor, maps: Tensor) -> tuple[Tensor, Tensor]:
        colour, coverage = warp_seen(photos, amounts, target, maps, OCCLUSION_MARGIN * pixel)
        return colour.flatten(1, 2), coverage

    names, arguments = ("colour", "coverage"), (photos[:count], data["sharpening"], data["maps"])
    yield from rows(names, (data[name] for name in names), warped, *arguments, entry="surface hidden_{}")
    return photos, fused
