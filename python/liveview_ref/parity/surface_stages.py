"""The stages of surface layers as functions of plain arrays, in either precision: the
reference of tests/parity/surface.rs.

Beside photos and cameras (rig_arrays.py): `range` [2] float64, near and far; `count`, planes of the
first search. Of photo 0, matched with the others: of many planes `half_ranges` [th, tw, 2];
`half_costs` [h/2, w/2, n], `half_found`,
`half_index` [h/2, w/2], `starts` [h/2, w/2, 2], `fine_costs` [h, w, 16], `fine_found`, `fine_index`
[h, w]; with anchors, `coarse{i}`, `coarse_sure{i}` [h/4, w/4] and `coarse_pixel` of its group,
`kept`, `anchor` [h/2, w/2], `anchored_costs` [h/2, w/2, n], `anchored` [h, w]. Of every photo i:
`depth{i}`, `confirmed{i}`, and with nearer edges `nearer{i}`, `sure{i}` [h, w], `pixel` [V]; of
all, `found_range` [2], 1/near and 1/far. At the target: `gains` [V, 3], `sharpening` [V],
`sharpened{i}` [h, w, 3], `splat`, `filled`, `searched`, `surface`, `seen` [H8, W8], `layers`
[3, H8, W8], `hidden_colour` [V, 3, H8, W8], `hidden_coverage`, `visible` [V, H8, W8],
`photo_variance` [7, H8, W8], `target_costs` [D, H8/4, W8/4].
"""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from ..reference.guided import median3, shrink
from ..reference.layers import warp_maps
from ..reference.liveview import padded_size, view_distances
from ..reference.surface.aggregate import aggregate
from ..reference.surface.anchored_depth import GROUP_PIXELS, SMALL_CELL, Group, anchored_depth, confirmed_by
from ..reference.surface.correction import exposure_gains, sharpened, sharpening
from ..reference.surface.depth_range import range_of
from ..reference.surface.fusion import AGREEMENT, FUSED, ConfirmedDepth, SurfaceView, confirmed, nearer_edges, splat
from ..reference.surface.photo_depth import FINE_STEPS, NEIGHBOURS, Anchors, PhotoDepth, bands, photo_depth, pixel_of
from ..reference.surface.photo_sweep import Candidates, Grid, costs, tile_ranges
from ..reference.surface.render import hide
from ..reference.surface.target_surface import (
    OCCLUSION_MARGIN,
    SEARCHED_VIEWS,
    cheapest,
    fill_holes,
    photo_variance,
    search_planes,
    seen,
    seen_or_past,
    surface,
    target_costs,
)
from ..reference.views import widest_parallax
from ..rig_arrays import Arrays, cameras_of, images_of

Stage = Callable[[Arrays, torch.dtype], Arrays]
LAYERS = 3
ADDED_SHARPENING = 0.05
OFFSETS = 1.5, 1.0, 0.5, 0.0, -0.5, -1.0, -1.5  # px by which the surface is moved


def tensor(data: Arrays, name: str, dtype: torch.dtype) -> Tensor:
    return torch.from_numpy(data[name]).to(dtype)


def photos(data: Arrays, dtype: torch.dtype, cell: int = 1) -> list[tuple]:
    """The photos, shrunk, and their cameras."""
    images = [shrink(image, cell) if cell > 1 else image for image in images_of(data, dtype)]
    return list(zip(images, cameras_of(data)[0], strict=True))


def neighbours(data: Arrays, which: int, dtype: torch.dtype, cell: int = 1) -> list[tuple]:
    """The photos that photo `which` is matched with: the first others."""
    all_ = photos(data, dtype, cell)
    return (all_[:which] + all_[which + 1 :])[:NEIGHBOURS]


def coarse_grid(data: Arrays) -> Grid:
    return Grid.of(*(float(x) for x in data["range"]), int(data["count"]))


def fine_grid(data: Arrays) -> Grid:
    return coarse_grid(data).divided(FINE_STEPS)


def fine_candidates(data: Arrays) -> Candidates:
    starts = torch.from_numpy(data["starts"].astype(np.int64))
    return Candidates.two(starts, *data["view0.image"].shape[:2])


def half_ranges(data: Arrays, dtype: torch.dtype) -> Arrays:
    """From coarse0; none of few planes."""
    size = photos(data, dtype, 2)[0][0].shape[1:]
    found = tile_ranges(tensor(data, "coarse0", dtype), coarse_grid(data), size)
    return {} if found is None else {"half_ranges": found.numpy()}


def half_costs(data: Arrays, dtype: torch.dtype) -> Arrays:
    image, camera = photos(data, dtype, 2)[0]
    candidates = Candidates.all(coarse_grid(data), *image.shape[1:])
    around = neighbours(data, 0, dtype, 2)
    ranges = torch.from_numpy(data["half_ranges"].astype(np.int64)) if "half_ranges" in data else None
    found = costs(image, camera, around, coarse_grid(data), candidates, 2, ranges)
    return {"half_costs": found.permute(1, 2, 0).numpy()}


def half_found(data: Arrays, dtype: torch.dtype) -> Arrays:
    image, _ = photos(data, dtype, 2)[0]
    candidates = Candidates.all(coarse_grid(data), *image.shape[1:])
    volume = tensor(data, "half_costs", torch.int64).permute(2, 0, 1)
    return {"half_found": aggregate(volume, image, candidates).numpy()}


def half_index(data: Arrays, dtype: torch.dtype) -> Arrays:
    return {"half_index": median3(tensor(data, "half_found", dtype)).numpy()}


def starts(data: Arrays, dtype: torch.dtype) -> Arrays:
    found = bands(tensor(data, "half_index", dtype), FINE_STEPS, fine_grid(data).count)
    return {"starts": found.numpy()}


def fine_costs(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Costs of the candidates that a cell has, 0 for the others."""
    image, camera = photos(data, dtype)[0]
    candidates, grid = fine_candidates(data), fine_grid(data)
    around = neighbours(data, 0, dtype)
    found = costs(image, camera, around, grid, candidates, 1)
    return {"fine_costs": torch.where(candidates.there, found, 0).permute(1, 2, 0).numpy()}


def fine_found(data: Arrays, dtype: torch.dtype) -> Arrays:
    image, _ = photos(data, dtype)[0]
    volume = tensor(data, "fine_costs", torch.int64).permute(2, 0, 1)
    return {"fine_found": aggregate(volume, image, fine_candidates(data)).numpy()}


def fine_index(data: Arrays, dtype: torch.dtype) -> Arrays:
    return {"fine_index": median3(tensor(data, "fine_found", dtype)).numpy()}


def depths(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Every photo's depth, from photos and cameras alone."""
    near, far = (float(x) for x in data["range"])
    views = photos(data, dtype)
    found = [photo_depth(v, neighbours(data, i, dtype), near, far) for i, v in enumerate(views)]
    maps = {f"depth{i}": depth.disparity.numpy() for i, depth in enumerate(found)}
    return maps | {"pixel": np.array([depth.pixel for depth in found])}


def coarse(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The maps of photo 0's group."""
    near, far = (float(x) for x in data["range"])
    found = Group.of(group_views(data, dtype), near, far).maps
    maps = {f"coarse{i}": depth.disparity.numpy() for i, (_, depth) in enumerate(found)}
    return maps | {"coarse_pixel": np.array([depth.pixel for _, depth in found])}


def group_views(data: Arrays, dtype: torch.dtype) -> list[tuple]:
    return [photos(data, dtype)[0], *neighbours(data, 0, dtype)]


def coarse_maps(data: Arrays, dtype: torch.dtype) -> list[tuple]:
    cameras = [camera.shrunk(SMALL_CELL) for _, camera in group_views(data, dtype)]
    pixels = data["coarse_pixel"]
    return [(c, PhotoDepth(tensor(data, f"coarse{i}", dtype), float(pixels[i]))) for i, c in enumerate(cameras)]


def coarse_confirmations(data: Arrays, dtype: torch.dtype) -> Arrays:
    """What the others of the group confirm of each."""
    maps = coarse_maps(data, dtype)
    found = [confirmed_by(own, maps[:i] + maps[i + 1 :], GROUP_PIXELS) for i, own in enumerate(maps)]
    return {f"coarse_sure{i}": (sure >= 0).to(dtype).numpy() for i, sure in enumerate(found)}


def anchors(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Of photo 0, from its half_index."""
    maps = coarse_maps(data, dtype)
    sure = [torch.from_numpy(data[f"coarse_sure{i}"]) > 0 for i in range(len(maps))]
    group = Group(maps, [torch.where(s, m.disparity, -1) for (_, m), s in zip(maps, sure, strict=True)])
    own = PhotoDepth(coarse_grid(data).disparity(tensor(data, "half_index", dtype)), float(data["pixel"][0]))
    found = group.anchors(cameras_of(data)[0][0].shrunk(2), own)
    return {"kept": found.kept.to(dtype).numpy(), "anchor": found.disparity.numpy()}


def anchored_costs(data: Arrays, dtype: torch.dtype) -> Arrays:
    found = Anchors(torch.from_numpy(data["kept"]) > 0, tensor(data, "anchor", dtype))
    volume = tensor(data, "half_costs", torch.int64).permute(2, 0, 1)
    return {"anchored_costs": found.added_to(volume, coarse_grid(data)).permute(1, 2, 0).numpy()}


def anchored(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The depth of photo 0 with anchors, from photos and cameras alone."""
    near, far = (float(x) for x in data["range"])
    photo, *around = group_views(data, dtype)
    return {"anchored": anchored_depth(photo, around, near, far).disparity.numpy()}


def confirmations(data: Arrays, dtype: torch.dtype) -> Arrays:
    cameras, _ = cameras_of(data)
    pixels = data["pixel"]
    maps = [(c, PhotoDepth(tensor(data, f"depth{i}", dtype), float(pixels[i]))) for i, c in enumerate(cameras)]
    return {f"confirmed{i}": confirmed(i, maps).to(dtype).numpy() for i in range(len(maps))}


def nearer(data: Arrays, dtype: torch.dtype) -> Arrays:
    set_ = photos(data, dtype)
    maps = [PhotoDepth(tensor(data, f"depth{i}", dtype), float(pixel)) for i, pixel in enumerate(data["pixel"])]
    sure = [torch.from_numpy(data[f"confirmed{i}"]) > 0 for i in range(len(set_))]
    return {f"nearer{i}": nearer_edges(i, set_, maps, sure[i]).numpy() for i in range(len(set_))}


def nearer_confirmations(data: Arrays, dtype: torch.dtype) -> Arrays:
    count = range(len(data["pixel"]))
    found = confirmations(data | {f"depth{i}": data[f"nearer{i}"] for i in count}, dtype)
    return {f"sure{i}": found[f"confirmed{i}"] for i in count}


def ranges(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Nearest and farthest disparity of what is confirmed; -1 if too little is."""
    kept = [tensor(data, f"depth{i}", dtype)[data[f"confirmed{i}"] > 0] for i in range(len(data["pixel"]))]
    found = range_of(torch.cat(kept), tuple(float(x) for x in data["range"]))
    return {"found_range": np.array([1 / depth for depth in found] if found else [-1.0, -1.0])}


def surface_views(data: Arrays, dtype: torch.dtype) -> list[SurfaceView]:
    found = []
    for i, (image, camera) in enumerate(photos(data, dtype)):
        depth = PhotoDepth(tensor(data, f"nearer{i}", dtype), float(data["pixel"][i]))
        sure = torch.from_numpy(data[f"sure{i}"]) > 0
        gains = tensor(data, "gains", dtype)[i] if "gains" in data else torch.ones(3, dtype=dtype)
        found.append(SurfaceView(image, camera, ConfirmedDepth.of(depth, sure), gains))
    return found


def exposures(data: Arrays, dtype: torch.dtype) -> Arrays:
    return {"gains": exposure_gains(surface_views(data, dtype), view_distances(*cameras_of(data))).numpy()}


def sharpness(data: Arrays, dtype: torch.dtype) -> Arrays:
    return {"sharpening": sharpening(surface_views(data, dtype)).numpy()}


def sharpened_photos(data: Arrays, dtype: torch.dtype) -> Arrays:
    """A little more is added, so that the stage has an effect where there is nothing to sharpen."""
    amounts = tensor(data, "sharpening", dtype) + ADDED_SHARPENING
    pairs = zip(images_of(data, dtype), amounts, strict=True)
    return {f"sharpened{i}": sharpened(image, a).permute(1, 2, 0).numpy() for i, (image, a) in enumerate(pairs)}


def target_pixel(data: Arrays) -> float:
    near, far = (float(x) for x in data["range"])
    cameras, target = cameras_of(data)
    size = padded_size(target.height, target.width)
    return pixel_of(widest_parallax(cameras, target, near, far, size), near, far)


def splatted(data: Arrays, dtype: torch.dtype) -> Arrays:
    _, target = cameras_of(data)
    maps = [(v.camera, v.confirmed.disparity) for v in surface_views(data, dtype)]
    margins = AGREEMENT * target_pixel(data), FUSED * target_pixel(data)
    return {"splat": splat(maps, target, *padded_size(target.height, target.width), *margins).numpy()}


def holes(data: Arrays, dtype: torch.dtype) -> Arrays:
    return {"filled": fill_holes(tensor(data, "splat", dtype)).numpy()}


def visibility(data: Arrays, dtype: torch.dtype) -> Arrays:
    """Which views see the surface, its holes filled, or see past it."""
    _, target = cameras_of(data)
    margin = OCCLUSION_MARGIN * target_pixel(data)
    return {"visible": seen_or_past(surface_views(data, dtype), target, tensor(data, "filled", dtype), margin).numpy()}


def photo_variances(data: Arrays, dtype: torch.dtype) -> Arrays:
    """On that surface, and on the surface moved by some pixels of parallax."""
    _, target = cameras_of(data)
    views = [(v.image, v.camera, v.gains) for v in surface_views(data, dtype)]
    sees, surface_ = tensor(data, "visible", dtype), tensor(data, "filled", dtype)
    maps = [(surface_ + offset * target_pixel(data)).clamp(min=0) for offset in OFFSETS]
    return {"photo_variance": torch.stack([photo_variance(views, sees, target, m) for m in maps]).numpy()}


def searches(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The target's own search, of its splat."""
    near, far = (float(x) for x in data["range"])
    views, (_, target) = surface_views(data, dtype)[:SEARCHED_VIEWS], cameras_of(data)
    size = padded_size(target.height, target.width)
    pixel = pixel_of(widest_parallax([v.camera for v in views], target, near, far, size), near, far)
    splatted = tensor(data, "splat", dtype)
    planes = search_planes(views, target, splatted, near, far)
    costs = target_costs(views, target, splatted, planes, OCCLUSION_MARGIN * pixel)
    return {"target_costs": costs.numpy(), "searched": cheapest(costs, planes).numpy()}


def surfaces(data: Arrays, dtype: torch.dtype) -> Arrays:
    """All stages at the target together, from the confirmed depths."""
    near, far = (float(x) for x in data["range"])
    found = surface(surface_views(data, dtype), cameras_of(data)[1], near, far)
    return {"surface": found.disparity.numpy(), "layers": found.layers(LAYERS).numpy()}


def hidden(data: Arrays, dtype: torch.dtype) -> Arrays:
    """The filled surface as a layer, warped, in balanced colours, without the occluded samples; and
    where any view sees it."""
    views, (_, target) = surface_views(data, dtype), cameras_of(data)
    map_ = tensor(data, "filled", dtype)
    warped = [warp_maps(v.image, v.camera, target, map_[None]) for v in views]
    colour, coverage = (torch.cat(x) for x in zip(*warped, strict=True))
    colour = colour * torch.stack([v.gains for v in views])[:, :, None, None]
    masks = seen(views, target, map_, OCCLUSION_MARGIN * target_pixel(data))
    found = hide(masks, colour, coverage)
    names = "hidden_colour", "hidden_coverage", "seen"
    return {name: value.to(dtype).numpy() for name, value in zip(names, found, strict=True)}


PHOTO = (half_costs, half_found, half_index, starts, fine_costs, fine_found, fine_index)
CORRECTION = exposures, sharpness, sharpened_photos
TARGET = (*CORRECTION, splatted, holes, visibility, photo_variances, searches, surfaces, hidden)
ANCHORS = (coarse, coarse_confirmations, anchors, anchored_costs, anchored)
CONFIRMATION = confirmations, nearer, nearer_confirmations
STAGES = (*PHOTO, depths, *ANCHORS, *CONFIRMATION, ranges, *TARGET)
INTEGERS = dict.fromkeys(("half_costs", "anchored_costs", "fine_costs", "starts"), np.uint16)  # the others are float32
