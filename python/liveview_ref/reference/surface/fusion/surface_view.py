"""A photo with its confirmed depth, as the fusion and the correction of photos take it."""

from typing import NamedTuple

from torch import Tensor

from liveview_ref.reference.geometry.camera import Camera

from .confirmed_depth import ConfirmedDepth


class SurfaceView(NamedTuple):
    """A photo [3, h, w], its camera and its confirmed depth; gains [3] multiply its colours."""

    image: Tensor
    camera: Camera
    confirmed: ConfirmedDepth
    gains: Tensor
