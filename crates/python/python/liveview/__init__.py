"""New views of a scene from a few posed photos, on numpy arrays.

    scene = liveview.Scene.from_arrays(photos, k, poses)
    frame = liveview.Synthesizer(scene).render(liveview.Camera(k, pose, width, height))
    frame.save("new.png")

`_liveview.pyi` documents every name, with shapes and units."""

from . import _liveview
from ._liveview import *  # noqa: F403
from ._tuples import Composited, PhotoDisparity, RangeMap, Surface, ViewDepth

__all__ = ["Composited", "PhotoDisparity", "RangeMap", "Surface", "ViewDepth"]
__all__ += [name for name in _liveview.__all__ if not name.startswith("_")]
