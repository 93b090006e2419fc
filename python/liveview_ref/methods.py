"""What the evaluation renders with a network: guided layers, uniform planes, and the paper's selection among them."""

from collections.abc import Callable

import torch
from torch import Tensor

from .blend import blend
from .compete import compete
from .composite import composite
from .guide import coarse_range, guided_layers
from .heldout import Case
from .layers import guided_maps, uniform_planes, upsample_maps
from .render import planes_over, view_distances, warp_views
from .select import kmeans_planes, plane_histogram, select_planes

Network = Callable[[Tensor], Tensor]  # hwv [n, 3V, H8, W8] -> logits [n, V, H8, W8]

GUIDED = 2, 4, 8
PLANES = 8, 16, 32, 64  # selected are some of the last
BATCH = 4


def infer(network: Network, case: Case, maps: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """alpha [L, H, W], rgb [L, 3, H, W] and whether any view covers the pixel [L, H, W] of layers [L, H8, W8], cropped
    to the target: what can be composited in any subset. A batch of layers at a time; no other stage is kept."""
    distances = view_distances(case.cameras, case.target)
    crop = (..., slice(case.target.height), slice(case.target.width))
    parts = []
    for part in maps.split(BATCH):
        colour, coverage = warp_views(case.sources, case.cameras, case.target, part)
        alpha, rgb = blend(network(colour.flatten(1, 2)), colour, coverage, distances)
        parts.append((alpha[crop], rgb[crop], (coverage > 0).any(1)[crop]))
    return tuple(torch.cat(x) for x in zip(*parts, strict=True))


def composited(layers: tuple[Tensor, Tensor, Tensor], maps: Tensor, ids: list[int]) -> Tensor:
    """Image [3, H, W] of these of the layers that `infer` gave."""
    alpha, rgb, covered = layers
    crop = (ids, slice(alpha.shape[1]), slice(alpha.shape[2]))
    return composite(alpha[ids], rgb[ids], covered[ids[-1]], maps[crop]).rgb


def layers_by_guide(case: Case) -> dict[str, Tensor]:
    """Guided layers [L, H8, W8] of each count; the search is done once."""
    found = coarse_range(*case[:3], case.near, case.far)
    return {f"guided {n}": upsample_maps(guided_maps(*found, n)) for n in GUIDED}


def uniform_maps(case: Case, count: int) -> Tensor:
    return planes_over(case.target, uniform_planes(case.near, case.far, count), torch.float32)


def maps_of(case: Case, guided: bool, count: int) -> Tensor:
    """`count` guided layers, or uniform planes, [L, H8, W8]."""
    return guided_layers(*case[:3], case.near, case.far, count) if guided else uniform_maps(case, count)


def guided(network: Network, case: Case):
    """(name, image [3, H, W]) for each number of guided layers."""
    for name, maps in layers_by_guide(case).items():
        yield name, composited(infer(network, case, maps), maps, list(range(len(maps))))


def planes(network: Network, case: Case):
    """(name, image) for each number of uniform planes, and for the K fullest of the largest number. A plane's alpha and
    colour do not depend on the others, so the selected planes need no second pass of the network."""
    for count in PLANES:
        maps = uniform_maps(case, count)
        layers = infer(network, case, maps)
        yield f"planes {count}", composited(layers, maps, list(range(count)))
    histogram = plane_histogram(layers[0])
    for few in PLANES[:-1]:
        yield f"selected {few} of {count}", composited(layers, maps, select_planes(histogram, few))


def infer_competing(network: Network, case: Case, maps: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """As `infer`, with logit 0 in alpha's place."""
    distances = view_distances(case.cameras, case.target)
    crop = (..., slice(case.target.height), slice(case.target.width))
    parts = []
    for part in maps.split(BATCH):
        colour, coverage = warp_views(case.sources, case.cameras, case.target, part)
        logits = network(colour.flatten(1, 2))
        rgb = blend(logits, colour, coverage, distances)[1]
        parts.append((logits[:, 0][crop], rgb[crop], (coverage > 0).any(1)[crop]))
    return tuple(torch.cat(x) for x in zip(*parts, strict=True))


def competing(network: Network, case: Case, scale: float = 1.0, counts: tuple[int, ...] = PLANES):
    """(name, image) for each number of uniform planes that compete, and for K of the largest number, which compete anew
    among themselves: those that win at the most pixels, and those next to the k-means of the winners' disparities."""
    crop = (..., slice(case.target.height), slice(case.target.width))
    for count in counts:
        maps = uniform_maps(case, count)
        logit, rgb, covered = infer_competing(network, case, maps)
        whole = compete(logit, rgb, covered, maps[crop], scale)
        if count == counts[-1]:
            histogram = plane_histogram(whole.weights)
            disparities = maps[:, 0, 0]
            winners = disparities[whole.weights.argmax(0)][covered.any(0)].numpy()
            for few in counts[:-1]:
                centres = torch.tensor(kmeans_planes(winners, few), dtype=disparities.dtype)
                near_by = (disparities - centres[:, None]).abs().argmin(1).unique().tolist()
                for way, ids in (("selected", select_planes(histogram, few)), ("k-means", near_by)):
                    image = compete(logit[ids], rgb[ids], covered[ids], maps[crop][ids], scale).rgb
                    yield f"competing, {way} {few} of {count}", image
        yield f"competing {count}", whole.rgb
