"""The comparison's rig: eleven parallel cameras in a plane, of which 4, 5 or 10 are used, and
targets in their middle.

The paper gives the number of views of its rigs, but not their places. Here a quincunx is a square
of side 1 with a camera at its centre; V = 10 are two quincunxes one side apart, V = 4 the corners
of the square between them, V = 5 these with the camera at the centre. Every number of views
therefore renders the same targets, which lie in that square.
"""

import math

import numpy as np
import torch

from liveview_ref.reference.liveview import Camera, uniform_disparities

WIDTH, HEIGHT = 504, 352  # the paper times its methods at 500 x 350
FOCAL = WIDTH / 2 / math.tan(math.radians(30))
PARALLAX = 32.0  # pixels between neighbouring corners at the nearest depth
SIDE = PARALLAX / FOCAL  # of a square, in units of the nearest depth
NEAR, FAR = 0.87, 25.0

_CORNERS = [(x, y) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
_OUTER = [(x, y) for x in (-1.5, 1.5) for y in (-0.5, 0.5)]
CENTRES = [(0.0, 0.0), *_CORNERS, *_OUTER, (-1.0, 0.0), (1.0, 0.0)]  # in sides, x to the right and y down
VIEWS = {4: [1, 2, 3, 4], 5: [0, 1, 2, 3, 4], 10: [9, 5, 6, 1, 2, 10, 3, 4, 7, 8]}
REFERENCES = {4: (0,), 5: (0,), 10: (0, 5)}  # indices of these, for methods that are not target-centred


def camera(x: float, y: float) -> Camera:
    """The camera at (x, y) sides from the rig's centre, looking along z."""
    k = torch.tensor([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]], dtype=torch.float64)
    translation = torch.tensor([-x * SIDE, -y * SIDE, 0.0], dtype=torch.float64)
    return Camera(k, torch.eye(3, dtype=torch.float64), translation, WIDTH, HEIGHT)


def target_places(rng: np.random.Generator, count: int) -> list[tuple[float, float]]:
    """Random places in the middle square, in sides."""
    return [tuple(place) for place in rng.uniform(-0.5, 0.5, (count, 2)).tolist()]


def planes(count: int) -> torch.Tensor:
    """Equi-disparity planes over all depths of the rig's scenes, near to far, [D] float64."""
    return uniform_disparities(NEAR, FAR, count)
