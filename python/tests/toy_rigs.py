"""Seeded photos and cameras for the tests of the reference."""

import numpy as np
import torch
from torch import Tensor

from liveview_ref.parity.rigs import rig
from liveview_ref.reference.liveview import Camera
from liveview_ref.rig_arrays import cameras_of, images_of


def rig_of(kind: str, views: int = 4) -> tuple[list[Tensor], list[Camera], Camera]:
    """Photos, their cameras and a target; kinds as in parity/rigs.py."""
    data = rig(np.random.default_rng(7), views, kind)
    cameras, target = cameras_of(data)
    return images_of(data, torch.float64), cameras, target
