"""What a method renders of a target: on each number of planes, and, where it makes each plane by itself at the target,
on selected planes and by competing planes too."""

from collections.abc import Iterator

import torch
from torch import Tensor

from ..reference.blend import blend
from ..reference.composite_competing import composite_competing
from ..reference.histogram import plane_histogram, select_planes
from .method import Method
from .methods.liveview import BATCH, Competing, PlaneByPlane, nearest_first
from .mpi import Mpi, opaque_background, over, padded, volume_at
from .shots import Shot

SELECTED = 8, 16, 32  # of the largest number of planes
COMPETING = ", competing"  # after the layers' name


def is_liveview(method: Method) -> bool:
    """Whether its planes are made one by one, at the target: only then can any of them be left out afterwards."""
    if isinstance(method, Competing):
        return True
    return isinstance(method, Mpi) and method.target_centred and isinstance(method.predictor, PlaneByPlane)


@torch.inference_mode()
def renderings(method: Method, shot: Shot, counts: tuple[int, ...], scale: float = 1.0) -> Iterator[tuple[str, Tensor]]:
    """(layers, image [3, H, W]) of each number of planes; `scale` of the logits of planes that compete."""
    if not is_liveview(method):
        for count in counts:
            yield f"planes:{count}", method(shot.photos, shot.camera, shot.planes(count)).rgb
        return
    for count in counts:
        planes = plane_by_plane(method, shot, shot.planes(count))
        yield f"planes:{count}", independent(*planes[:2], list(range(count)))
        yield f"planes:{count}{COMPETING}", competing(planes, list(range(count)), scale)[0]
    alone, together = (plane_histogram(x) for x in (planes[0], competing(planes, list(range(count)), scale)[1]))
    for few in [few for few in SELECTED if few < count]:
        yield f"select:{few}/{count}", independent(*planes[:2], select_planes(alone, few))
        yield f"select:{few}/{count}{COMPETING}", competing(planes, select_planes(together, few), scale)[0]


def plane_by_plane(method: Method, shot: Shot, disparities: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """alpha [D, H, W], rgb [D, 3, H, W], logit of alpha and whether any photo covers the pixel [D, H, W]."""
    camera, parts = padded(shot.camera), []
    photos = nearest_first(shot.photos, shot.camera) if isinstance(method, Competing) else shot.photos
    crop = (..., slice(shot.camera.height), slice(shot.camera.width))
    for some in disparities.split(BATCH):
        volume, coverage, distances = volume_at(camera, photos, some)
        logits = method.predictor.logits(volume).contiguous()
        alpha, rgb = blend(logits, volume, coverage, distances)
        parts.append([x[crop] for x in (alpha, rgb, logits[:, 0], (coverage > 0).any(1))])
    return tuple(torch.cat(x) for x in zip(*parts, strict=True))


def independent(alpha: Tensor, rgb: Tensor, ids: list[int]) -> Tensor:
    """The paper's composite of these planes, the farthest of them opaque."""
    return over(opaque_background(alpha[ids]), rgb[ids])


def competing(planes: tuple[Tensor, ...], ids: list[int], scale: float) -> tuple[Tensor, Tensor]:
    """Image and weights [len(ids), H, W] of these planes as they compete."""
    _, rgb, logit, covered = (x[ids] for x in planes)
    shown = composite_competing(logit, rgb, covered, torch.zeros_like(logit), scale)
    return shown.rgb, shown.weights
