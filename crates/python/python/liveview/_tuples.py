"""Results of several arrays, as the reference names them."""

from typing import NamedTuple

import numpy as np

from ._liveview import _surface_layers


class Composited(NamedTuple):
    """Composited layers: rgb [3, H, W] in [0, 1]; disparity [H, W], 1/scene unit; transmittance
    [H, W], what is left behind the last layer; weights [L, H, W] of the layers. float32."""

    rgb: np.ndarray
    disparity: np.ndarray
    transmittance: np.ndarray
    weights: np.ndarray


class RangeMap(NamedTuple):
    """Per cell of 2 x 2 pixels of the padded target, the disparities [h, w] between which the scene
    lies, and that of its surface, 1/scene unit. float32."""

    nearest: np.ndarray
    surface: np.ndarray
    farthest: np.ndarray


class PhotoDisparity(NamedTuple):
    """Disparity [h, w] that a photo's search finds (float32), and the disparity worth one pixel of
    parallax; 1/scene unit."""

    disparity: np.ndarray
    pixel: float


class Surface(NamedTuple):
    """Disparity [h, w] of the padded target (float32), the disparity worth one pixel, both 1/scene
    unit, the share of the target that no confirmed depth falls on, and how far each pixel's colour
    is trusted, up to 1, [h, w] (float32)."""

    disparity: np.ndarray
    pixel: float
    holes: float
    confidence: np.ndarray | None = None

    def layers(self, count: int) -> np.ndarray:
        """`count` layers [L, h, w] along the surface, near to far: one follows it; two are its
        largest and its smallest disparity over 3 x 3 pixels; three are these with the surface
        between them; more divide that range evenly."""
        return _surface_layers(self.disparity, count)


class ViewDepth(NamedTuple):
    """The depth of a photo of a scene: disparity [h, w] (float32, -1 where unknown); which pixels
    other photos confirm, [h, w] bool; the disparity worth one pixel of parallax; nearest and
    farthest depth searched, scene units. Disparities are 1/scene unit."""

    disparity: np.ndarray
    confirmed: np.ndarray
    pixel: float
    range: tuple[float, float]
