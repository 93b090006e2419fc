"""The target's own search of its holes, which starts from what the photos confirm.

On cells of 4 x 4 pixels: photos are averaged, the views' confirmed depths and the splat are medians
of what a cell holds. The cost of a plane: the variance of the colours of the views that see it, a
cost for each view that sees past it, and in cells with a splatted depth a cost of the distance from
it, the anchor. Aggregated along four paths, the cheapest plane, 3x3 median, enlarged.
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor

from liveview_ref.reference.geometry.camera import Camera
from liveview_ref.reference.geometry.parallax import widest_parallax
from liveview_ref.reference.layers.cells import upsample_maps
from liveview_ref.reference.layers.guided.matching_cost import shrink, window_variance
from liveview_ref.reference.layers.guided.range_map import median3
from liveview_ref.reference.layers.guided.semi_global import semi_global
from liveview_ref.reference.layers.guided.winner_takes_all import winner_takes_all
from liveview_ref.reference.layers.uniform import uniform_disparities
from liveview_ref.reference.warp import warp_maps

from .surface_view import SurfaceView
from .visible import visible_or_past

CELL = 4  # target pixels per side of a cell
LEAST_CONFIRMED = 4  # pixels with a depth that give their cell one
PLANE_SPACING = 3.0  # px of parallax between the planes
LEAST_PLANES, MOST_PLANES = 8, 192
WINDOW = 5  # cells over which the variance is averaged
UNSEEN_COST = 0.02  # where fewer than two views see any of them
PAST_COST = 0.01  # of a view that sees past
ANCHOR_COST = 0.07  # of a plane far from the anchor
ANCHOR_REACH = 4.0  # planes from which on that is paid
STEP_PENALTY, JUMP_PENALTY = 0.004, 0.4


def target_search(
    views: list[SurfaceView], target: Camera, splatted: Tensor, near: float, far: float, margin: float
) -> Tensor:
    """Disparity [h, w] of the padded target, whose splat has -1 in holes; `margin` is that of
    visibility."""
    planes = search_planes(views, target, splatted, near, far)
    return cheapest(target_costs(views, target, splatted, planes, margin), planes)


def cheapest(costs: Tensor, planes: Tensor) -> Tensor:
    """Disparity [h, w] of each pixel at these costs [D, h, w] of the planes."""
    maps = planes.to(costs)[:, None, None].expand_as(costs)
    found = winner_takes_all(semi_global(costs, STEP_PENALTY, JUMP_PENALTY), maps)
    return upsample_maps(median3(found)[None], CELL)[0]


def search_planes(views: list[SurfaceView], target: Camera, splatted: Tensor, near: float, far: float) -> Tensor:
    """Disparities [D], near -> far."""
    parallax = widest_parallax([v.camera for v in views], target, near, far, tuple(splatted.shape))
    count = math.ceil(min(parallax / PLANE_SPACING, MOST_PLANES)) + 1
    return uniform_disparities(near, far, min(max(count, LEAST_PLANES), MOST_PLANES))


def target_costs(views: list[SurfaceView], target: Camera, splatted: Tensor, planes: Tensor, margin: float) -> Tensor:
    """Costs [D, h, w] of the planes at the cells."""
    reach = ANCHOR_REACH * float(planes[0] - planes[-1]) / (len(planes) - 1)
    height, width = (side // CELL for side in splatted.shape)
    maps = planes.to(splatted)[:, None, None].expand(-1, height, width)
    colours, coverages, past = [], [], 0
    for view in views:
        colour, coverage = warp_maps(shrink(view.image, CELL), view.camera, target, maps, CELL)
        camera, confirmed = view.camera.shrunk(CELL), cell_medians(view.confirmed.disparity)
        sees = torch.stack([visible_or_past(camera, confirmed, target.shrunk(CELL), map_, margin) for map_ in maps])
        past = past + PAST_COST * ((sees < 0) & (coverage > 0.5)).to(splatted)
        colours.append(colour * view.gains[:, None, None])
        coverages.append(torch.where(sees > 0, coverage, 0))
    costs = window_variance(torch.stack(colours, 1), torch.stack(coverages, 1), WINDOW, UNSEEN_COST)
    anchors = cell_medians(splatted)
    share = ((anchors - maps).abs() / reach).clamp(max=1)
    return costs + (past + torch.where(anchors >= 0, ANCHOR_COST * share, 0))


def cell_medians(map_: Tensor) -> Tensor:
    """The median of the values of each cell of a map [h, w] (-1: none; the lower of the two in the
    middle); -1 where a cell has too few."""
    height, width = map_.shape
    padded = F.pad(map_, (0, -width % CELL, 0, -height % CELL), value=-1)
    values = padded.unfold(0, CELL, CELL).unfold(1, CELL, CELL).flatten(2).sort(descending=True).values
    count = (values >= 0).sum(2, keepdim=True)
    median = values.gather(2, (count // 2).clamp(max=CELL * CELL - 1))[..., 0]
    return torch.where(count[..., 0] >= LEAST_CONFIRMED, median, -1)
