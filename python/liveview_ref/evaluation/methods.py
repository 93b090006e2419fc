"""What the evaluation renders with a network: guided layers, uniform planes, the paper's selection among them, and
competing planes. Each yields (layers, image [3, H, W]), the layers as layer_spec.py writes them."""

import torch
from torch import Tensor

from ..data.held_out import Case
from ..reference.blend import blend
from ..reference.composite import composite
from ..reference.composite_competing import composite_competing
from ..reference.cover import cover_planes
from ..reference.guided import guided_layers, guided_search
from ..reference.histogram import plane_histogram, select_planes
from ..reference.kmeans import kmeans_planes
from ..reference.layer_spec import DisparityList, Guided, KMeans, LayerSpec, Planes, Select
from ..reference.layers import guided_maps, plane_maps, uniform_disparities, upsample_maps
from ..reference.renderer import Network, warp_views
from ..reference.view_selection import view_distances

GUIDED = 2, 4, 8
PLANES = 8, 16, 32, 64  # selected are some of the last
BATCH = 4


def infer(network: Network, case: Case, maps: Tensor, competing: bool = False) -> tuple[Tensor, Tensor, Tensor]:
    """alpha [L, H, W] (for competing planes logit 0 instead), rgb [L, 3, H, W] and whether any view covers the pixel
    [L, H, W] of layers [L, H8, W8], cropped to the target: what can be composited in any subset. A batch of layers at a
    time; no other stage is kept."""
    distances = view_distances(case.cameras, case.target)
    crop = (..., slice(case.target.height), slice(case.target.width))
    parts = []
    for part in maps.split(BATCH):
        colour, coverage = warp_views(case.sources, case.cameras, case.target, part)
        logits = network(colour.flatten(1, 2))
        alpha, rgb = blend(logits, colour, coverage, distances)
        parts.append(((logits[:, 0] if competing else alpha)[crop], rgb[crop], (coverage > 0).any(1)[crop]))
    return tuple(torch.cat(x) for x in zip(*parts, strict=True))


def composited(layers: tuple[Tensor, Tensor, Tensor], maps: Tensor, ids: list[int]) -> Tensor:
    """Image [3, H, W] of these of the layers that `infer` gave."""
    alpha, rgb, covered = layers
    crop = (ids, slice(alpha.shape[1]), slice(alpha.shape[2]))
    return composite(alpha[ids], rgb[ids], covered[ids[-1]], maps[crop]).rgb


def guided_maps_of(case: Case) -> dict[str, Tensor]:
    """Guided layers [L, H8, W8] of each count; the search is done once."""
    found = guided_search(*case[:3], case.near, case.far)
    return {str(Guided(n)): upsample_maps(guided_maps(*found, n)) for n in GUIDED}


def maps_of(case: Case, layers: LayerSpec) -> Tensor:
    """Layers [L, H8, W8] of the kinds that need no network to be chosen."""
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
        yield name, composited(infer(network, case, maps), maps, list(range(len(maps))))


def planes(network: Network, case: Case, counts: tuple[int, ...] = PLANES):
    """Each number of uniform planes, and the fullest of the largest number. A plane's alpha and colour do not depend on
    the others, so the selected planes need no second pass of the network."""
    for count in counts:
        maps = maps_of(case, Planes(count))
        layers = infer(network, case, maps)
        if count == counts[-1]:
            histogram = plane_histogram(layers[0])
            for few in counts[:-1]:
                yield str(Select(few, count)), composited(layers, maps, select_planes(histogram, few))
        yield str(Planes(count)), composited(layers, maps, list(range(count)))


def competing(network: Network, case: Case, scale: float = 1.0, counts: tuple[int, ...] = PLANES):
    """Each number of uniform planes that compete, and of the largest number a few, which compete anew among themselves:
    those that lie nearest to the winners, and those next to the k-means of the winners' disparities."""
    crop = (..., slice(case.target.height), slice(case.target.width))
    for count in counts:
        maps = maps_of(case, Planes(count))
        logit, rgb, covered = infer(network, case, maps, competing=True)
        whole = composite_competing(logit, rgb, covered, maps[crop], scale)
        if count == counts[-1]:
            histogram = plane_histogram(whole.weights)
            disparities = maps[:, 0, 0]
            winners = disparities[whole.weights.argmax(0)][covered.any(0)].numpy()
            for few in counts[:-1]:
                centres = torch.tensor(kmeans_planes(winners, few), dtype=disparities.dtype)
                near_by = (disparities - centres[:, None]).abs().argmin(1).unique().tolist()
                selections = {
                    Select(few, count): cover_planes(histogram, few),
                    f"{KMeans(few)} of {Planes(count)}": near_by,
                }
                for layers, ids in selections.items():
                    image = composite_competing(logit[ids], rgb[ids], covered[ids], maps[crop][ids], scale).rgb
                    yield f"competing, {layers}", image
        yield f"competing, {Planes(count)}", whole.rgb
