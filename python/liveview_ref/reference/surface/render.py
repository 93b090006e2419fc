"""The default picture, which needs no network: layers along the surface that the photos' depth
gives.

1. The photos that show the target: those to render from, and a few that only help to find depth.
2. The depth of each, searched among its nearest photos (anchored_depth.py); confirmed by the
   others, edges moved to the nearer side, confirmed again (fusion.py).
3. Exposure and sharpness brought to one (correction.py).
4. The surface at the target (target_surface.py), and layers along it.
5. Warp of the corrected photos, each without the samples that its own depth says are occluded.
6. Logits from how well the views agree, blend, competing composite.
"""

from collections.abc import Callable

import torch
from torch import Tensor

from ..competing import composite_competing
from ..layers import warp_maps
from ..liveview import Camera, Composited, Intermediates, blend, view_distances
from ..view_agreement import agreement_logits
from ..views import nearest_first, with_helpers
from .anchored_depth import anchored_depth
from .correction import CORRECTED_POWER, corrected, exposure_gains, sharpening
from .fusion import ConfirmedDisparity, SurfaceView, confirmed, nearer_edges
from .photo_depth import NEIGHBOURS, PhotoDisparity, View
from .target_surface import OCCLUSION_MARGIN, seen, surface

EXTRA_PHOTOS = 2  # beside those to render from, for the depth
LEAST_COVERAGE = 0.05  # summed over the views; a pixel with more is seen


def neighbours_of(cameras: list[Camera], which: int) -> list[int]:
    """The photos among which the depth of photo `which` is searched: the nearest to it."""
    return [i for i in nearest_first(cameras, cameras[which]) if i != which][:NEIGHBOURS]


def confirmed_views(photos: list[View], depths: list[PhotoDisparity]) -> list[SurfaceView]:
    """Photos with what the others of them confirm of their depth, once its edges are moved."""
    cameras = [camera for _, camera in photos]

    def sure(maps: list[PhotoDisparity]) -> list[Tensor]:
        return [confirmed(i, list(zip(cameras, maps, strict=True))) for i in range(len(maps))]

    first = sure(depths)
    moved = [d._replace(disparity=nearer_edges(i, photos, depths, first[i])) for i, d in enumerate(depths)]
    found = zip(photos, moved, sure(moved), strict=True)
    return [SurfaceView(*photo, ConfirmedDisparity.of(d, s), torch.ones(3).to(d.disparity)) for photo, d, s in found]


def hide(masks: Tensor, colour: Tensor, coverage: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Colour [V, 3, h, w] and coverage [V, h, w] of a layer without the occluded samples, where
    masks [V, h, w] are 0; and whether any view sees the pixel, [h, w] bool. Where the coverage that
    remains, summed over the views, is too small, the occlusion of all views is ignored."""
    left = torch.zeros_like(coverage[0])
    for mask, covered in zip(masks, coverage, strict=True):
        left = left + mask * covered
    seen = left > LEAST_COVERAGE
    masks = torch.where(seen, masks, 1)
    return colour * masks[:, None], coverage * masks, seen


def warp_seen(
    views: list[SurfaceView], amounts: Tensor, target: Camera, maps: Tensor, margin: float
) -> tuple[Tensor, Tensor]:
    """The photos, corrected by their gains and these amounts of sharpening, on layers [L, H8, W8]
    without occluded samples: colour [L, V, 3, H8, W8], coverage [L, V, H8, W8]. A view's own depth
    hides what it is `margin` nearer than."""
    photos = corrected([v.image for v in views], torch.stack([v.gains for v in views]), amounts)

    def layer(map_: Tensor) -> tuple[Tensor, Tensor]:
        both = [warp_maps(photo, v.camera, target, map_[None]) for photo, v in zip(photos, views, strict=True)]
        colour, coverage = (torch.cat(x) for x in zip(*both, strict=True))
        return hide(seen(views, target, map_, margin), colour, coverage)[:2]

    colour, coverage = zip(*(layer(map_) for map_ in maps), strict=True)
    return torch.stack(colour), torch.stack(coverage)


def render(
    photos: list[View],
    target: Camera,
    near: float,
    far: float,
    views: int,
    layers: int = 3,
    search: Callable[[View, list[View], float, float], PhotoDisparity] = anchored_depth,
) -> tuple[Composited, Intermediates]:
    """A picture from `views` of the photos [3, h, w] of a scene, whose depth lies between near and
    far, cropped to the target's size; the intermediates are not. alpha is that of the paper, which
    the competing composite does not use. `search` finds the depth of a photo among others."""
    cameras = [camera for _, camera in photos]
    chosen = with_helpers(cameras, target, views, EXTRA_PHOTOS)
    depths = [search(photos[i], [photos[j] for j in neighbours_of(cameras, i)], near, far) for i in chosen]
    around = confirmed_views([photos[i] for i in chosen], depths)
    distances = view_distances([v.camera for v in around], target)
    gains = exposure_gains(around, distances)
    around = [view._replace(gains=gain) for view, gain in zip(around, gains, strict=True)]
    shown, distances = around[:views], distances[:views]
    amounts = sharpening(shown)
    found = surface(around, target, near, far)
    maps = found.layers(layers)
    colour, coverage = warp_seen(shown, amounts, target, maps, OCCLUSION_MARGIN * found.pixel)
    logits = agreement_logits(colour, coverage)
    alpha, rgb = blend(logits, colour, coverage, distances, CORRECTED_POWER)
    full = composite_competing(logits[:, 0], rgb, (coverage > 0).any(1), maps)
    crop = (..., slice(target.height), slice(target.width))
    picture = Composited(full.rgb[crop], full.disparity[crop], full.transmittance[crop], full.weights[crop])
    return picture, Intermediates(colour, coverage, logits, alpha, rgb)
