"""The renderings of a target by a method: on each number of planes, and, if it makes each plane
independently at the target, also on selected planes and by competing planes."""

from collections.abc import Iterator
from typing import NamedTuple

import torch
from torch import Tensor

from liveview_ref.reference.competing import composite_competing, cover_planes
from liveview_ref.reference.liveview import blend, plane_histogram, select_planes

from ..data.shots import Shot
from ..methods.liveview import BATCH, Competing, PlaneByPlane, nearest_first
from ..methods.method import Method
from ..methods.mpi import Mpi, opaque_background, over, padded, volume_at

SELECTED = 8, 16, 32  # of the largest number of planes
COMPETING = ", competing"  # suffix of the name of competing layers
ALL = slice(None)


class Planes(NamedTuple):
    """alpha [D, H, W], rgb [D, 3, H, W], logit of alpha and whether any photo covers the pixel
    [D, H, W]; near to far, at the size of the target."""

    alpha: Tensor
    rgb: Tensor
    logit: Tensor
    covered: Tensor


def is_liveview(method: Method) -> bool:
    """Whether its planes are made independently, at the target: only then can planes be
    left out afterwards."""
    return isinstance(method, Mpi) and method.target_centred and isinstance(method.predictor, PlaneByPlane)


@torch.inference_mode()
def renderings(method: Method, shot: Shot, counts: tuple[int, ...], scale: float = 1.0) -> Iterator[tuple[str, Tensor]]:
    """(layers, image [3, H, W]) of each number of planes; `scale` of the logits of competing
    planes. Planes are selected as the program selects them: by the paper's histogram, or, if they
    compete, by `cover_planes`."""
    if not is_liveview(method):
        for count in counts:
            yield f"planes:{count}", method(shot.photos, shot.camera, shot.planes(count)).rgb
        return
    for count in counts:
        planes = plane_by_plane(method, shot, shot.planes(count))
        together, weights = competing(planes, scale)
        yield f"planes:{count}", independent(planes)
        yield f"planes:{count}{COMPETING}", together
    alone, shared = plane_histogram(planes.alpha), plane_histogram(weights)
    for few in [few for few in SELECTED if few < count]:
        yield f"select:{few}/{count}", independent(planes, select_planes(alone, few))
        yield f"select:{few}/{count}{COMPETING}", competing(planes, scale, cover_planes(shared, few))[0]


def plane_by_plane(method: Method, shot: Shot, disparities: Tensor) -> Planes:
    camera, parts = padded(shot.camera), []
    photos = nearest_first(shot.photos, shot.camera) if isinstance(method, Competing) else shot.photos
    crop = (..., slice(shot.camera.height), slice(shot.camera.width))
    for some in disparities.split(BATCH):
        volume, coverage, distances = volume_at(camera, photos, some)
        logits = method.predictor.logits(volume).contiguous()
        alpha, rgb = blend(logits, volume, coverage, distances)
        parts.append([x[crop] for x in (alpha, rgb, logits[:, 0], (coverage > 0).any(1))])
    return Planes(*(torch.cat(x) for x in zip(*parts, strict=True)))


def independent(planes: Planes, ids: list[int] | slice = ALL) -> Tensor:
    """The paper's composite of these planes, the farthest one opaque."""
    return over(opaque_background(planes.alpha[ids]), planes.rgb[ids])


def competing(planes: Planes, scale: float, ids: list[int] | slice = ALL) -> tuple[Tensor, Tensor]:
    """Image and weights [len(ids), H, W] of these planes in competition."""
    _, rgb, logit, covered = (x[ids] for x in planes)
    shown = composite_competing(logit, rgb, covered, torch.zeros_like(logit), scale)
    return shown.rgb, shown.weights
