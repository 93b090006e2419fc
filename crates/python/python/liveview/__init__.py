"""New views of a scene from a few posed photos, on numpy arrays.

    scene = liveview.Scene.from_arrays(photos, k, poses)
    frame = liveview.Synthesizer(scene).render(liveview.Camera(k, pose, width, height))
    frame.save("new.png")

`_liveview.pyi` documents every name, with shapes and units."""

from . import _liveview, _poses, cameras
from ._liveview import *  # noqa: F403
from ._tuples import Composited, PhotoDisparity, RangeMap, Surface, ViewDepth

__all__ = ["Composited", "PhotoDisparity", "RangeMap", "Surface", "ViewDepth", "cameras", "poses"]
__all__ += [name for name in _liveview.__all__ if not name.startswith("_")]


def poses(inputs, scene, *, progress=None):
    """A scene of photos without poses, found by COLMAP (`pip install pycolmap`), as `liveview
    poses` does it.

    inputs: a photo, a folder of photos or a video, or a list of these. scene: a new folder, for
    sparse/0 and links to the photos. progress(step, done, of) is called as it goes on. Returns the
    `Scene`, and what was found: photos and registered (how many), left_out (why, by name), notes.
    ValueError for unusable input."""
    listed = inputs if isinstance(inputs, (list, tuple)) else [inputs]
    report = (lambda **line: progress(line["step"], line["done"], line["of"])) if progress else (lambda **line: None)
    found = _poses.poses(listed, scene, report)
    return _liveview.Scene(scene), found
