"""Camera poses with OpenGL axes (x right, y up, z backwards), as in transforms.json."""

import numpy as np


def flip_axes(world_from_cam: np.ndarray) -> np.ndarray:
    """A pose [3, 4] or [4, 4] with OpenGL camera axes -> with OpenCV's (y down, z forward),
    or the reverse."""
    return world_from_cam @ np.diag([1.0, -1.0, -1.0, 1.0])
