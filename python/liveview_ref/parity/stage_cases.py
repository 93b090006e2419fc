"""Seeded cases of the stages from photos to frame, for python/tests/binding: a stage's inputs are
the float32 roundings of the oracle's outputs of the stage before, so that a failure names the first
stage that differs."""

import functools

import numpy as np
import torch

from ..reference.guided import search_planes
from ..reference.liveview import UNet, uniform_disparities
from ..rig_arrays import Arrays, cameras_of
from ..weights import start_from_agreement
from . import stages
from .rigs import rig

NEAR, FAR = 1.0, 8.0

CASES = {  # name: (V, rig, planes or guided layers)
    "random_v4": (4, "random", uniform_disparities(NEAR, FAR, 6)),
    "random_v5": (5, "random", uniform_disparities(NEAR, FAR, 4)),
    "random_v10": (10, "random", uniform_disparities(NEAR, FAR, 3)),
    "rectified_v2": (2, "rectified", uniform_disparities(NEAR, FAR, 8)),
    "one_plane": (4, "random", torch.tensor([0.4], dtype=torch.float64)),
    "infinity": (4, "random", torch.tensor([0.9, 0.5, 0.01, 0.0], dtype=torch.float64)),
    "coincident": (4, "coincident", uniform_disparities(NEAR, FAR, 4)),
    "unseen": (4, "unseen", uniform_disparities(0.6, float("inf"), 5)),
    "guided_v4": (4, "random", 4),
    "guided_v5": (5, "random", 3),
    "guided_v2": (2, "rectified", 2),
    "guided_one": (4, "random", 1),
    "competing_v4": (4, "random", uniform_disparities(NEAR, FAR, 12)),
    "competing_unseen": (4, "unseen", uniform_disparities(0.6, float("inf"), 5)),
    "competing_guided": (4, "random", 3),
    "spaced_v4": (4, "random", uniform_disparities(NEAR, FAR, 12)),
    "spaced_uneven": (4, "random", torch.tensor([0.9, 0.9, 0.89, 0.5, 0.0], dtype=torch.float64)),
    "spaced_one": (4, "random", torch.tensor([0.4], dtype=torch.float64)),
    "spaced_unseen": (4, "unseen", uniform_disparities(0.6, float("inf"), 5)),
}
ALPHA_SCALES = {"competing_v4": 2.0, "competing_unseen": 1.0, "competing_guided": 60.0}  # of competing layers
# Where opacity is per pixel of parallax:
ALPHA_SPACINGS = {"spaced_v4": 2.0, "spaced_uneven": 3.0, "spaced_one": 3.0, "spaced_unseen": 3.0}


def case(name: str) -> tuple[Arrays, Arrays]:
    """The inputs of every stage, and the oracle's outputs."""
    views, kind, layers = CASES[name]
    data = rig(np.random.default_rng([2021, list(CASES).index(name)]), views, kind)
    if name in ALPHA_SCALES:
        data["alpha_scale"] = np.array([ALPHA_SCALES[name]])
    if name in ALPHA_SPACINGS:
        data["alpha_spacing"] = np.array([ALPHA_SPACINGS[name]])
    if isinstance(layers, int):
        data["coarse_disparities"] = search_planes(*cameras_of(data), NEAR, FAR).numpy()
        data["cell_maps"] = np.empty(layers)  # its length is the number of layers that the stage makes
    else:
        data["disparities"] = layers.numpy()
    oracle = {}
    for stage in stages.STAGES:
        found = stage(data, torch.float64)
        oracle |= found
        if stage is stages.spacing:
            data |= found
        elif stage not in (stages.homography, stages.composited):
            data |= {name: value.astype(np.float32) for name, value in found.items()}
        if stage is stages.warp:
            oracle |= stages.agreement(data, torch.float64)
            oracle["logits"] = stages.logits(network(views), data["colour"], torch.float64)
            data["logits"] = oracle["logits"].astype(np.float32)
    return data, oracle


@functools.cache
def network(views: int) -> UNet:
    """An untrained network whose BatchNorms' statistics, scales and biases differ from those of a
    new network as a trained network's do."""
    torch.manual_seed(views)
    net = UNet(views).eval()
    start_from_agreement(net)
    with torch.no_grad():
        for norm in (module for module in net.modules() if isinstance(module, torch.nn.BatchNorm2d)):
            norm.running_mean.normal_(0, 0.1)
            norm.running_var.uniform_(0.25, 4)
            norm.weight.uniform_(0.5, 1.5)
            norm.bias.normal_(0, 0.1)
    return net
