"""The guided search: two searches for the disparity of least matching cost, the second at
twice the resolution.

At 1/4 resolution: sweep the views through planes a cell of parallax apart, take the variance of
their colours over a window, aggregate it along rows and columns (semi_global.py) and keep the
cheapest plane, refined between planes by a parabola. The largest and smallest disparity of the
neighbourhood, half a plane step wider, are the range searched at 1/2 resolution: the same without
aggregation, over a few layers that divide the range of each cell. The extremes of what this finds
are the final range. Known in stereo as adaptive thin volumes (Cheng et al., UCS-Net, 2020).
"""

import math

from torch import Tensor

from liveview_ref.reference.geometry.camera import Camera
from liveview_ref.reference.geometry.parallax import widest_parallax

from ..cells import CELL, padded_size, upsample_maps
from ..uniform import uniform_disparities
from .matching_cost import layer_costs
from .range_map import RangeMap, guided_maps, range_of
from .semi_global import semi_global
from .winner_takes_all import winner_takes_all

COARSE_CELL = 4  # target pixels per cell of the first search
LEAST_PLANES, MOST_PLANES = 8, 128  # of the first search
FINE_LAYERS = 6  # of the second search
WINDOWS = 3, 7  # cells over which the variance is averaged in each search


def search_planes(cameras: list[Camera], target: Camera, near: float, far: float, planes: int | None = None) -> Tensor:
    """Disparities of the first search, [D] float64: `planes` of them, or as many as lie a cell of
    parallax apart."""
    parallax = widest_parallax(cameras, target, near, far, padded_size(target.height, target.width))
    count = math.ceil(min(parallax / COARSE_CELL, MOST_PLANES))
    return uniform_disparities(near, far, planes or max(count, LEAST_PLANES))


def fine_layers(found: RangeMap) -> Tensor:
    """The layers of the second search, which divide the range that the first found:
    [FINE_LAYERS, h, w], cells of CELL pixels."""
    return upsample_maps(guided_maps(*found, FINE_LAYERS), COARSE_CELL // CELL)


def guided_search(
    views: list[Tensor], cameras: list[Camera], target: Camera, near: float, far: float, planes: int | None = None
) -> RangeMap:
    """The range of each cell of CELL x CELL pixels of the padded target; `planes` as search_planes
    takes it."""
    disparities = search_planes(cameras, target, near, far, planes).to(views[0].dtype)
    height, width = (side // COARSE_CELL for side in padded_size(target.height, target.width))
    maps = disparities[:, None, None].expand(-1, height, width)
    costs = semi_global(layer_costs(views, cameras, target, maps, COARSE_CELL, WINDOWS[0]))
    step = float(disparities[0] - disparities[1])
    layers = fine_layers(range_of(winner_takes_all(costs, maps), step / 2))
    costs = layer_costs(views, cameras, target, layers, CELL, WINDOWS[1])
    return range_of(winner_takes_all(costs, layers))


def guided_layers(
    views: list[Tensor],
    cameras: list[Camera],
    target: Camera,
    near: float,
    far: float,
    count: int,
    planes: int | None = None,
) -> Tensor:
    """`count` guided layers as full-resolution disparity maps [L, H8, W8] over the padded target,
    near -> far."""
    return upsample_maps(guided_maps(*guided_search(views, cameras, target, near, far, planes), count))
