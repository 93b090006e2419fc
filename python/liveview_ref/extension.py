"""The package `liveview` of this tree, from the wheel that `make wheel` builds; not installed."""

import importlib
import sys
import tempfile
import zipfile

import numpy as np

from .paths import ROOT
from .reference.liveview import Camera

WHEELS = sorted((ROOT / "target/wheels").glob("liveview-*.whl"), key=lambda path: path.stat().st_mtime)
if not WHEELS:
    raise ImportError(f"{ROOT / 'target/wheels'}: no wheel of liveview; expected one, which `make wheel` builds")

FOLDER = tempfile.TemporaryDirectory(prefix="liveview-", ignore_cleanup_errors=True)  # until this process ends
with zipfile.ZipFile(WHEELS[-1]) as archive:
    archive.extractall(FOLDER.name)
sys.path.insert(0, FOLDER.name)
liveview = importlib.import_module("liveview")


def in_memory(photos: list[np.ndarray], cameras: list[Camera]):
    """A scene of photos [h, w, 3], uint8 or float32, and their cameras."""
    poses = np.stack([np.eye(4)] * len(cameras))
    for pose, camera in zip(poses, cameras, strict=True):
        pose[:3, :3], pose[:3, 3] = camera.rotation, camera.translation
    return liveview.Scene.from_arrays(photos, [camera.k.numpy() for camera in cameras], poses)
