"""Undistort photos: the pinhole image with the same K and size, sampled at the distorted
position of each of its pixels. Edge pixels are repeated outwards."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor


@dataclass(frozen=True)
class Distortion:
    """OpenCV's coefficients: of `FULL_OPENCV`, or of the fisheye, which has k1 to k4 only."""

    fisheye: bool = False
    k: tuple[float, ...] = (0.0,) * 6
    p: tuple[float, ...] = (0.0,) * 2

    def distort(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """The point at z = 1 where the photo shows the pinhole ray (x, y, 1)."""
        (k1, k2, k3, k4, k5, k6), (p1, p2) = self.k, self.p
        r2 = x * x + y * y
        if self.fisheye:
            theta = r2.sqrt().atan()
            t2 = theta * theta
            scale = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)))) / r2.sqrt()
            scale = torch.where(r2 > 0, scale, 1.0)
            return x * scale, y * scale
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return xd, yd


def undistort(image: Tensor, k: Tensor, distortion: Distortion) -> Tensor:
    """The pinhole image [3, H, W] of a distorted photo, in its dtype; `k` is float64."""
    height, width = image.shape[1:]
    rows, columns = torch.arange(height, dtype=k.dtype), torch.arange(width, dtype=k.dtype)
    y, x = torch.meshgrid(rows + 0.5, columns + 0.5, indexing="ij")
    xd, yd = distortion.distort((x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1])
    u, v = (xd * k[0, 0] + k[0, 2]) / width * 2 - 1, (yd * k[1, 1] + k[1, 2]) / height * 2 - 1
    grid = torch.stack([u, v], -1).to(image.dtype)[None]
    return F.grid_sample(image[None], grid, padding_mode="border", align_corners=False)[0]
