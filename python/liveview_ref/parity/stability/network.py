"""Extreme inputs of the network: constant, saturated, denormal, tiny and very long pictures.

Photos hold no denormal values, since arithmetic with these is ten times as slow on some CPUs.
"""

import functools
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from ...checkpoint import exported_network
from ...extension import liveview
from ...onnx_session import session
from .case import FLOAT32, Case, Inputs, Outputs, units

BOUND = 2e-6  # relative to the largest logit: up to 1,728 products are summed, in any order
SIZE = 64, 96  # height and width of most cases, pixels
MAX_SIDE = 16384
REPETITIONS = 9  # timed runs
WARM_UP = 3  # runs before these


@dataclass
class Networks:
    """A model in the package, in torch and in onnxruntime, each on one thread."""

    file: Path

    @functools.cached_property
    def rust(self):
        return liveview.Network(self.file, threads=1)

    @functools.cached_property
    def torch(self):
        return exported_network(self.file)

    @functools.cached_property
    def onnxruntime(self):
        return session(self.file, 1)


@dataclass
class Network(Inputs):
    """Warped photos hwv [1, 3V, h, w]."""

    stage = "network"
    relative = True
    networks: Networks
    hwv: np.ndarray

    def rust(self) -> Outputs:
        return outputs(self.networks.rust(self.hwv))

    def equivalent(self) -> Outputs:
        """Those of onnxruntime, which runs the same library."""
        return outputs(self.networks.onnxruntime.run(["logits"], {"hwv": self.hwv})[0])

    @torch.inference_mode()
    def others(self) -> dict[str, Outputs]:
        in_torch = self.networks.torch.float()(torch.from_numpy(self.hwv))
        return {"torch": outputs(in_torch.numpy()), "onnxruntime": self.equivalent()}

    @torch.inference_mode()
    def truth(self) -> Outputs:
        return outputs(self.networks.torch.double()(torch.from_numpy(self.hwv).double()).numpy())

    def relative_time(self) -> float:
        """The ratio of median times, interleaved with runs on noise of the same size."""
        ordinary = units(3, *self.hwv.shape)
        times = [[self.seconds(hwv) for hwv in (self.hwv, ordinary)] for _ in range(WARM_UP + REPETITIONS)]
        own, other = np.median(times[WARM_UP:], 0)
        return float(own / other)

    def seconds(self, hwv: np.ndarray) -> float:
        started = time.perf_counter()
        self.networks.rust(hwv)
        return time.perf_counter() - started


def outputs(logits: np.ndarray) -> Outputs:
    return {"logits": logits.reshape(*logits.shape[:2], -1)}


def families(networks: Networks) -> list[list[Case]]:
    channels = 3 * networks.rust.views

    def noise(height: int, width: int) -> np.ndarray:
        return units(3, 1, channels, height, width)

    def everywhere(value: float) -> np.ndarray:
        return np.full((1, channels, *SIZE), value, np.float32)

    def in_photo(value: float) -> np.ndarray:
        """As the warp samples it."""
        camera = liveview.Camera(np.diag([1.0, 1, 1]), np.eye(4), 1, 1)
        photo = np.full((3, 1, 1), value, np.float32)
        return everywhere(liveview.warp_maps(photo, camera, camera, np.zeros((1, 1, 1), np.float32))[0].flat[0])

    channel, y, x = np.ogrid[:channels, : SIZE[0], : SIZE[1]]
    one_view = noise(*SIZE)
    one_view[:, 3:] = 0
    special = {
        "noise": noise(*SIZE),
        "all 0": everywhere(0),
        "all 0.5": everywhere(0.5),
        "all 1": everywhere(1),
        "0 and 1 side by side": ((channel // 3 + y + x) % 2 == 0).astype(np.float32)[None],
        "one view alone": one_view,
        "denormal (1e-40), in a photo": in_photo(1e-40),
        "2⁻¹²⁶, in a photo": in_photo(FLOAT32.tiny),
        "2⁻⁶⁴, in a photo": in_photo(2.0**-64),
        "smallest picture, 8x8": noise(8, 8),
        "longest picture, 16384x8": noise(8, MAX_SIDE),
    }
    return [[Case("network", name, Network(networks, hwv), BOUND) for name, hwv in special.items()]]
