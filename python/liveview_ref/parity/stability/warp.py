"""Extreme cases of the warp, one view on one plane, and the same warp in float64."""

import functools
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn

from ...extension import liveview
from ...reference import layers
from ...reference.liveview import Camera, PlaneSweep, grid_from_pixels, kornia_samples, with_coverage
from .. import fifty_digits
from .case import FLOAT32, Inputs, Outputs
from .onnx_graph import Graph

# A pixel is doubtful if its source coordinates move by more than this, in pixels, when the terms of
# (u, v, w) change in the last bit of float32: every float32 implementation rounds these.
DOUBTFUL_PIXELS = 0.01

# Error bound of float32 samples of a photo in [0, 1]: about the last bit of their distance in
# pixels from the middle of a run of pixels, which the warp computes in float64.
BOUND = 2e-5


class Module(nn.Module):
    """image [1, 4, h, w], homography [3, 3] (normalised source coordinates from target pixels),
    pixels [3, P] -> [1, 4, P, 1]."""

    def forward(self, image, homography, pixels):
        points = homography @ pixels
        grid = layers.outside_masked((points[:2] / points[2]).T[None, :, None], points[2][None, :, None])
        return F.grid_sample(image, grid, padding_mode="zeros", align_corners=False)


@functools.cache
def graph() -> Graph:
    inputs = torch.rand(1, 4, 8, 9), torch.eye(3), torch.rand(3, 5)
    return Graph(Module(), inputs, {"input0": {2: "h", 3: "w"}, "input2": {1: "p"}})


def outputs(colour, coverage) -> Outputs:
    return {"colour": np.asarray(colour).reshape(3, -1), "coverage": np.asarray(coverage).reshape(-1)}


@dataclass
class Warp(Inputs):
    """A photo [3, h, w], warped by one plane of the target, of this disparity (1/scene unit)."""

    stage = "warp"
    photo: np.ndarray
    source: Camera
    target: Camera
    disparity: float
    must_cover: bool = True  # else the source must cover no pixel
    equivalent_rig: "Warp | None" = None  # its outputs must be equal to the last bit
    well_conditioned: "Warp | None" = None  # an equivalent rig that float64 represents well, for the expected outputs

    def __post_init__(self):
        self.disparity = float(np.float32(self.disparity))  # the precision of the pixels' disparities

    def maps(self) -> np.ndarray:
        return np.full((1, self.target.height, self.target.width), self.disparity, np.float32)

    def rust(self) -> Outputs:
        return outputs(*liveview.warp_maps(self.photo, self.source, self.target, self.maps()))

    def equivalent(self) -> Outputs | None:
        return self.equivalent_rig and self.equivalent_rig.rust()

    def others(self) -> dict[str, Outputs]:
        photo, rig, size = torch.from_numpy(self.photo), (self.source, self.target), self.maps().shape[1:]
        in_torch = layers.warp_maps(photo, *rig, torch.from_numpy(self.maps()))
        kornia = kornia_samples(photo, *rig, self.disparity, size)
        homography = grid_from_pixels(photo.shape[2], photo.shape[1])
        homography = homography @ PlaneSweep.of(*rig).source_from_target(self.disparity)
        pixels = pixel_centres(self.target).astype(np.float32)
        (samples,) = graph()(with_coverage(photo)[None].numpy(), homography.float().numpy(), pixels)
        return {
            "torch": outputs(*in_torch),
            "kornia": outputs(kornia[:3], kornia[3]),
            "onnxruntime": outputs(samples[0, :3], samples[0, 3]),
        }

    def uvw_terms(self) -> np.ndarray:
        """The terms of x, y, 1 and the disparity [4, 3, P], whose sum is the homogeneous source
        pixel (u, v, w) of a target pixel. Computed from rays and poses, without PlaneSweep, so that
        they share no fault."""
        source, target = ([x.numpy() for x in (c.k, c.rotation, c.translation)] for c in (self.source, self.target))

        def ray(p: np.ndarray) -> np.ndarray:
            """K^-1 p, by substitution from below."""
            (fx, skew, cx), (_, fy, cy), _ = target[0]
            down = (p[1] - cy * p[2]) / fy
            return np.stack([(p[0] - skew * down - cx * p[2]) / fx, down, p[2]])

        def turned(v: np.ndarray) -> np.ndarray:
            """From the target's axes to those of the world and of the source."""
            return source[1] @ (target[1].T @ v)

        pixels = pixel_centres(self.target)
        rays = [turned(ray(pixels * axis[:, None])) for axis in np.eye(3)]
        shift = (source[2] - turned(target[2])) * self.disparity
        return np.stack([source[0] @ v for v in (*rays, np.broadcast_to(shift[:, None], pixels.shape))])

    def doubtful(self) -> np.ndarray:
        if self.well_conditioned:
            return self.well_conditioned.doubtful()
        terms = self.uvw_terms()
        u, v, w = uvw = terms.sum(0)
        bits = np.abs(terms).sum(0) * float(FLOAT32.eps)
        # Not doubtful if certainly outside: inside, -1 < u/w < side + 1 for the largest w.
        largest = np.maximum(w, 0) + bits[2]
        reaches = w >= -bits[2]
        for at, bit, side in zip((u, v), bits, self.photo.shape[:0:-1], strict=False):
            reaches &= (at + bit > -largest) & (at - bit < (side + 1) * largest)
        with np.errstate(all="ignore"):
            moved = (bits + np.abs(uvw / w) * bits[2]) / np.abs(w)
            # In this form a division by 0 counts as doubtful.
            return reaches & ~((w > bits[2]) & (np.fmax(*moved[:2]) <= DOUBTFUL_PIXELS))

    def truth(self) -> Outputs:
        if self.well_conditioned:
            return self.well_conditioned.truth()
        uvw = self.uvw_terms().sum(0)
        with np.errstate(all="ignore"):
            at = uvw[:2] / uvw[2]
        front = (uvw[2] > 0) & np.isfinite(at).all(0)
        rgbc = bilinear(self.photo, *np.where(front, at, -9))
        return outputs(rgbc[:3], rgbc[3])

    def digits(self, pixel: int) -> list | None:
        if self.well_conditioned:
            return None
        return fifty_digits.warp(self.photo, self.source, self.target, self.disparity, pixel)


def pixel_centres(camera: Camera) -> np.ndarray:
    """(x, y, 1) of all pixels, [3, P]."""
    y, x = np.mgrid[: camera.height, : camera.width].reshape(2, -1) + 0.5
    return np.stack([x, y, np.ones_like(x)])


def bilinear(photo: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """RGB and coverage [4, P] at points of the photo (pixel centres at halves), zeros outside."""
    rgbc = np.concatenate([photo, np.ones_like(photo[:1])]).astype(np.float64)
    left, top = np.floor(x - 0.5), np.floor(y - 0.5)
    across, down = x - 0.5 - left, y - 0.5 - top
    total = np.zeros((4, len(x)))
    for column, row, weight in (
        (left, top, (1 - across) * (1 - down)),
        (left + 1, top, across * (1 - down)),
        (left, top + 1, (1 - across) * down),
        (left + 1, top + 1, across * down),
    ):
        inside = (column >= 0) & (row >= 0) & (column < photo.shape[2]) & (row < photo.shape[1])
        texels = rgbc[:, row[inside].astype(int), column[inside].astype(int)]
        total[:, inside] += weight[inside] * texels
    return total
