"""Seeded cases: the stages of a picture on given layers, and of surface layers on a small scene in
memory."""

import functools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from toy_rigs import rig, surface_rig

from liveview_ref.extension import in_memory, liveview
from liveview_ref.parity import compared, stages, surface
from liveview_ref.parity.compared import Compared, in_dtype, joined, row
from liveview_ref.parity.render import Rendered
from liveview_ref.reference.competing import composite_competing
from liveview_ref.reference.layers import warp_maps, warp_views
from liveview_ref.reference.liveview import Camera, UNet, blend, composite, uniform_disparities, view_distances
from liveview_ref.reference.surface.depth_range import range_of
from liveview_ref.reference.surface.fusion import SurfaceView, visible_or_past
from liveview_ref.reference.surface.photo_depth import CELL, PhotoDisparity, pixel_of, planes_of
from liveview_ref.reference.surface.photo_sweep import Grid
from liveview_ref.reference.surface.render import hide
from liveview_ref.reference.surface.target_surface import (
    OCCLUSION_MARGIN,
    SEARCHED_VIEWS,
    cheapest,
    photo_variance,
    search_planes,
    seen,
    target_costs,
)
from liveview_ref.reference.views import widest_parallax
from liveview_ref.rig_arrays import Arrays, cameras_of, images_of
from liveview_ref.weights import start_from_agreement

NEAR, FAR = 1.0, 8.0
OFFSETS = 1.5, 1.0, 0.5, 0.0, -0.5, -1.0, -1.5  # px by which the surface is moved


def evenly(count: int, near: float = NEAR, far: float = FAR) -> list[float]:
    return uniform_disparities(near, far, count).tolist()


CASES = {  # name: (V, rig, planes or guided layers, how opacity is meant)
    "random_v4": (4, "random", evenly(6), {}),
    "random_v5": (5, "random", evenly(4), {}),
    "random_v10": (10, "random", evenly(3), {}),
    "rectified_v2": (2, "rectified", evenly(8), {}),
    "one_plane": (4, "random", [0.4], {}),
    "infinity": (4, "random", [0.9, 0.5, 0.01, 0.0], {}),
    "coincident": (4, "coincident", evenly(4), {}),
    "unseen": (4, "unseen", evenly(5, 0.6, np.inf), {}),
    "guided_v4": (4, "random", 4, {}),
    "guided_v5": (5, "random", 3, {}),
    "guided_v2": (2, "rectified", 2, {}),
    "guided_one": (4, "random", 1, {}),
    "competing_v4": (4, "random", evenly(12), {"alpha_scale": 2.0}),
    "competing_unseen": (4, "unseen", evenly(5, 0.6, np.inf), {"alpha_scale": 1.0}),
    "competing_guided": (4, "random", 3, {"alpha_scale": 60.0}),
    "uneven": (4, "random", [0.9, 0.9, 0.89, 0.5, 0.0], {}),
}

SURFACE_CASES: dict[str, dict] = {  # photos, rig, near and far
    "scene": {"views": 5},
    "many": {"views": 7},
    "sizes": {"views": 4, "kind": "sizes"},
    "one_neighbour": {"views": 2},
    "rectified": {"views": 4, "kind": "rectified"},
    "identical": {"views": 3, "kind": "identical"},
    "flat": {"views": 3, "kind": "flat"},
    "exposure": {"views": 3, "kind": "exposure"},
    "infinity": {"views": 3, "span": (2.0, np.inf)},
    "near_is_far": {"views": 3, "span": (5.0, 5.0 * (1 + 1e-6))},
    "moving": {"views": 4, "kind": "moving", "span": (1.0, np.inf)},
    "wide": {"views": 3, "span": (0.5, 9.0)},
}


def rendered(name: str, model: Path, batch: int = 1) -> tuple[stages.Rig, Arrays]:
    """A case of a picture, and every stage of it by the package."""
    views, kind, layers, alpha = CASES[name]
    data = rig(np.random.default_rng([2021, list(CASES).index(name)]), views, kind)
    of = stages.Rig(images_of(data, torch.float32), *cameras_of(data))
    found, given = {}, layers
    if isinstance(layers, int):
        found = liveview._stages.guided_search(*of, (NEAR, FAR), layers)
        given = found["cell_maps"]
    return of, found | liveview._stages.render(model, *of, given, batch, **alpha)


def rows(of: stages.Rig, data: Arrays) -> Iterator[Compared]:
    """Every stage of a case of a picture."""
    if "costs" in data:
        yield from stages.guided_search(data, of)
    else:
        yield stages.homography(of, data["disparities"])
    yield from stages.warp(data, of)
    yield stages.logits(data, network(len(of.images)))
    yield from stages.picture(data, of)


def end_to_end(of: stages.Rig, data: Arrays, dtype: torch.dtype) -> torch.Tensor:
    """The frame [3, H, W] from photos and layers alone, every stage in `dtype`."""
    maps, (images, cameras, target) = in_dtype(data["maps"], dtype), in_dtype(tuple(of), dtype)
    colour, coverage = warp_views(images, cameras, target, maps)
    logits = network(len(images)).to(dtype)(colour.flatten(1, 2))
    alpha, rgb = blend(logits, colour, coverage, view_distances(cameras, target))
    covered = (coverage > 0).any(1)
    if "alpha_scale" in data:
        out = composite_competing(logits[:, 0], rgb, covered, maps, data["alpha_scale"])
    else:
        out = composite(alpha, rgb, covered[-1], maps)
    return out.rgb[:, : target.height, : target.width].detach()


@functools.cache
def network(views: int) -> UNet:
    """An untrained network whose BatchNorms' statistics, scales and biases differ from those of a
    new network as a trained network's do."""
    torch.manual_seed(views)
    net = UNet(views).eval()
    start_from_agreement(net)
    with torch.no_grad():
        for norm in (module for module in net.modules() if isinstance(module, torch.nn.BatchNorm2d)):
            norm.running_mean.normal_(0, 0.1)
            norm.running_var.uniform_(0.25, 4)
            norm.weight.uniform_(0.5, 1.5)
            norm.bias.normal_(0, 0.1)
    return net


def surface_case(name: str) -> Rendered:
    """A case of surface layers by the package: of up to four photos all are rendered from, of more
    two are helpers."""

    def of(views: int, kind: str = "scene", span: tuple[float, float] = (2.0, 9.0)) -> Rendered:
        data = surface_rig(np.random.default_rng([2021, 14, list(SURFACE_CASES).index(name)]), views, kind)
        cameras, target = cameras_of(data)
        scene = in_memory([data[f"view{i}.image"] for i in range(views)], cameras)
        count = views if views <= 4 else views - 2
        near, far = span
        return Rendered.of(scene, target, layers="surface:3", network=False, views=count, near=near, far=far)

    return of(**SURFACE_CASES[name])


def surface_stages(case: Rendered) -> Iterator[Compared]:
    """Every stage of a case of surface layers: the search of each photo's depth, of the first with
    anchors."""
    span, views, target = tuple(case.data["surface.range"].tolist()), case.views(case.photos), case.target
    for which, view in enumerate(case.photos):
        around = case.views([view, *case.neighbours(view)])
        grid, _ = planes_of(around[0][1], [camera for _, camera in around[1:]], *span)
        _, index = yield from surface.first_search(surface.CellSearch(around, span, grid, CELL))
        found = liveview.photo_depth(around[0], around[1:], *span)
        yield from surface.second_search(around, span, grid, index, found)
        if which == 0:
            groups = [[own, *around[:i], *around[i + 1 :]] for i, own in enumerate(around)]
            yield from surface.photo_search(groups, span, liveview.anchored_depth(around[0], around[1:], *span))
    depths = [PhotoDisparity(case.data[f"depth{i}"], float(pixel)) for i, pixel in enumerate(case.data["pixel"])]
    maps = [(camera, depth) for (_, camera), depth in zip(views, depths, strict=True)]
    sure = np.concatenate([depth.disparity[liveview.confirmed(i, maps)] for i, (_, depth) in enumerate(maps)])
    found = np.float32([1 / end for end in liveview._stages.depth_range(sure, span) or (-1, -1)])
    yield row("found_range", found, ends, sure, span, entry=surface.SURFACE)
    photos, fused = yield from surface.at_target(views, target, span, case.data)
    yield from inside_target(photos, target, span, fused)


def inside_target(
    photos: list[SurfaceView], target: Camera, span: surface.Span, fused: np.ndarray
) -> Iterator[Compared]:
    """What is inside the surface at the target and the warp, on the filled surface."""
    pixel = liveview._stages.pixel_of(photos, target, *span)
    margin, filled = OCCLUSION_MARGIN * pixel, liveview.fill_holes(fused)
    each = [(photo.camera, photo.confirmed.disparity, target, filled, margin) for photo in photos]
    sees = np.stack([liveview.visible_or_past(*of_view) for of_view in each])
    yield row("visible", sees, seen, photos, target, filled, margin, visible_or_past, entry=surface.SURFACE)
    plain = np.stack([liveview.visible(*of_view) for of_view in each])
    yield row("visible", plain, seen, photos, target, filled, margin, entry=surface.SURFACE)

    def variance(photos: list[SurfaceView], sees: Tensor, map_: Tensor) -> Tensor:
        return photo_variance([(photo.image, photo.camera, photo.gains) for photo in photos], sees, target, map_)

    for offset in OFFSETS:
        map_ = np.maximum(filled + np.float32(offset * pixel), np.float32(0))
        found = liveview._stages.photo_variance(photos, sees, target, map_)
        yield row("photo_variance", found, variance, photos, sees, map_, entry=surface.SURFACE)
    searching = photos[:SEARCHED_VIEWS]
    volume, found = liveview._stages.target_search(searching, target, fused, *span)
    pixel = pixel_of(widest_parallax([p.camera for p in searching], target, *span, fused.shape), *span)

    def searched(searching: list[SurfaceView], fused: Tensor) -> tuple[Tensor, Tensor]:
        planes = search_planes(searching, target, fused, *span)
        volume = target_costs(searching, target, fused, planes, OCCLUSION_MARGIN * pixel)
        return volume, cheapest(volume, planes)

    yield from compared.rows(
        ("target_costs", "searched"), (volume, found), searched, searching, fused, entry=surface.SURFACE
    )

    def balanced(photos: list[SurfaceView], map_: Tensor) -> tuple[Tensor, ...]:
        both = [warp_maps(photo.image, photo.camera, target, map_[None]) for photo in photos]
        found = hide(seen(photos, target, map_, margin), *(torch.cat(part) for part in zip(*both, strict=True)))
        return found[0] * torch.stack([photo.gains for photo in photos])[:, :, None, None], *found[1:]

    names = "hidden_colour", "hidden_coverage", "seen"
    colour, coverage, any_ = liveview._stages.hide(photos, target, filled, margin)
    found = colour.reshape(-1, 3, *filled.shape), coverage, any_
    yield from compared.rows(names, found, balanced, photos, filled, entry=surface.SURFACE)


def surface_rows(case: Rendered) -> Iterator[Compared]:
    """The same stage of several photos is one row."""
    yield from joined(surface_stages(case))


def ends(disparities: torch.Tensor, span: tuple[float, float]) -> list[float]:
    """The depths of confirmed disparities, as disparities; -1 if too few are."""
    return [1 / end for end in range_of(disparities, span) or (-1, -1)]


def many_planes() -> Iterator[Compared]:
    """The first search of 4,096 planes."""
    data = surface_rig(np.random.default_rng([2021, 14, 99]), 3, "scene")
    data |= {name: value[:24, :40] for name, value in data.items() if name.endswith(".image")}
    views = list(zip(images_of(data, torch.float32), cameras_of(data)[0], strict=True))
    search = surface.CellSearch(views, (2.0, 9.0), Grid.of(2.0, 9.0, 4096), CELL)
    yield from surface.first_search(search)
