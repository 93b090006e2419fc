"""Renderings of the evaluation with a network: guided layers, uniform planes, the paper's selection
among them, and competing planes. Each yields (layers, image [3, H, W]), the layers in the text form
of layers/spec.py."""

import torch
from torch import Tensor

from ..data.held_out import Case
from ..layer_spec import DisparityList, Guided, LayerSpec, Planes, Select
from ..reference.competing import composite_competing, cover_planes
from ..reference.guided import guided_layers, guided_maps, guided_search
from ..reference.layers import plane_maps, upsample_maps, warp_views
from ..reference.liveview import (
    Network,
    blend,
    composite,
    plane_histogram,
    select_planes,
    uniform_disparities,
    view_distances,
)

GUIDED = 2, 4, 8
PLANES = 8, 16, 32, 64  # selection is from the last
BATCH = 4


def infer(network: Network, case: Case, maps: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Logit 0 [L, H, W], rgb [L, 3, H, W] and whether any view covers the pixel [L, H, W] of layers
    [L, H8, W8], cropped to the target, ready for compositing in any subset. Runs one batch of
    layers at a time and keeps no other stage."""
    distances = view_distances(case.cameras, case.target)
    crop = (..., slice(case.target.height), slice(case.target.width))
    parts = []
    for part in maps.split(BATCH):
        colour, coverage = warp_views(case.sources, case.cameras, case.target, part)
        logits = network(colour.flatten(1, 2))
        rgb = blend(logits, colour, coverage, distances)[1]
        parts.append((logits[:, 0][crop], rgb[crop], (coverage > 0).any(1)[crop]))
    return tuple(torch.cat(x) for x in zip(*parts, strict=True))


def composited(layers: tuple[Tensor, Tensor, Tensor], maps: Tensor) -> tuple[Tensor, Tensor]:
    """Alpha [L, H, W] and image [3, H, W] of layers from `infer`."""
    logit, rgb, covered = layers
    alpha = torch.sigmoid(logit) * covered
    return alpha, composite(alpha, rgb, covered[-1], maps[..., : alpha.shape[1], : alpha.shape[2]]).rgb


def guided_maps_of(case: Case) -> dict[str, Tensor]:
    """Guided layers [L, H8, W8] of each count; the search is done once."""
    found = guided_search(*case[:3], case.near, case.far)
    return {str(Guided(n)): upsample_maps(guided_maps(*found, n)) for n in GUIDED}


def maps_of(case: Case, layers: LayerSpec) -> Tensor:
    """Layers [L, H8, W8] of the kinds that are chosen without a network."""
    match layers:
        case Planes(count):
            planes = uniform_disparities(case.near, case.far, count)
            return plane_maps(case.target, planes, torch.float32)
        case DisparityList(disparities):
            return plane_maps(case.target, torch.tensor(disparities, dtype=torch.float64), torch.float32)
        case Guided(count, coarse_planes):
            return guided_layers(*case[:3], case.near, case.far, count, coarse_planes)
        case _:
            raise ValueError(f"{layers}: expected planes, list or guided")


def guided(network: Network, case: Case):
    """Each number of guided layers."""
    for name, maps in guided_maps_of(case).items():
        yield name, composited(infer(network, case, maps), maps)[1]


def planes(network: Network, case: Case, counts: tuple[int, ...] = PLANES):
    """Each number of uniform planes, and the fullest of the largest number. The network's output
    for a plane does not depend on the others, so the selected planes need no second pass."""
    for count in counts:
        maps = maps_of(case, Planes(count))
        layers = infer(network, case, maps)
        alpha, image = composited(layers, maps)
        if count == counts[-1]:
            histogram = plane_histogram(alpha)
            for few in counts[:-1]:
                ids = select_planes(histogram, few)
                yield str(Select(few, count)), composited([x[ids] for x in layers], maps[ids])[1]
        yield str(Planes(count)), image


def competing(network: Network, case: Case, scale: float = 1.0, counts: tuple[int, ...] = PLANES):
    """Each number of competing uniform planes, and a few selected from the largest number, which
    compete again among themselves: those nearest to every pixel's best plane."""
    crop = (..., slice(case.target.height), slice(case.target.width))
    for count in counts:
        maps = maps_of(case, Planes(count))
        logit, rgb, covered = infer(network, case, maps)
        whole = composite_competing(logit, rgb, covered, maps[crop], scale)
        if count == counts[-1]:
            histogram = plane_histogram(whole.weights)
            for few in counts[:-1]:
                ids = cover_planes(histogram, few)
                image = composite_competing(logit[ids], rgb[ids], covered[ids], maps[crop][ids], scale).rgb
                yield f"competing, {Select(few, count)}", image
        yield f"competing, {Planes(count)}", whole.rgb
