"""The photos from which the depth range of a scene is found: a few groups of neighbours, spread
over the scene, at a small size."""

import math

from liveview_ref.reference.geometry.view_selection import nearest_first
from liveview_ref.reference.layers.guided.matching_cost import shrink

from .range import Range, depth_range
from .search.photo_depth import View

GROUPS = 4  # of photos, evenly spread in their order
GROUP_PHOTOS = 5  # of a group: one and its neighbours
SMALL_SIDE = 160.0  # pixels that the longer side is brought closest to, by a whole factor


def found_range(views: list[View]) -> Range | None:
    """Near and far from some of the photos; the widest range that is possible where they confirm
    too little, None if no two neighbouring cameras are in different places."""
    cameras = [camera for _, camera in views]
    around = [[i for i in nearest_first(cameras, camera) if i != own] for own, camera in enumerate(cameras)]
    distances = [float((cameras[i].centre - cameras[a[0]].centre).norm()) for i, a in enumerate(around) if a]
    distances = sorted(distance for distance in distances if distance > 0)
    if not distances:
        return None
    near = distances[len(distances) // 2]
    count = min(GROUPS, len(views))
    middles = [(2 * group + 1) * len(views) // (2 * count) for group in range(count)]
    groups = [[middle, *around[middle]][:GROUP_PHOTOS] for middle in middles]
    small = {i: reduced(views[i]) for group in groups for i in group}
    searched = [[small[i] for i in group] for group in groups if len(group) > 1]
    return depth_range(searched, near, math.inf) or (near, math.inf)


def reduced(view: View) -> View:
    """A photo and its camera at the small size."""
    image, camera = view
    factor = max(math.floor(max(camera.width, camera.height) / SMALL_SIDE + 0.5), 1)
    small = shrink(image, factor) if factor > 1 else image
    return small, camera.with_size_scaled(small.shape[2], small.shape[1])
