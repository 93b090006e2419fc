"""The cameras of a procedural scene with the rays of all their pixels, and the fragments of
surfaces in them."""

from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor


@dataclass
class World:
    """Cameras 0 (target) to V in the target's frame: k, r [C, 3, 3], t [C, 3]; sizes (H, W).
    Disparities of surfaces in the target are between `farthest` and 1; `reach` is the
    distance of the farthest camera."""

    k: np.ndarray
    r: np.ndarray
    t: np.ndarray
    sizes: list[tuple[int, int]]
    farthest: float
    reach: float
    base: list[int] = field(init=False)  # first pixel of each camera in the flat list, and their number

    def __post_init__(self):
        self.base = [0, *np.cumsum([h * w for h, w in self.sizes]).tolist()]
        self.rays_of = np.swapaxes(self.r, 1, 2) @ np.linalg.inv(self.k)  # pixel -> ray, in the target's frame
        self.origins = -np.einsum("cji,cj->ci", self.r, self.t)
        self.focal = self.k[:, 0, 0]
        self.size = self.sizes[0]
        self.extent = max(max(size) for size in self.sizes)
        xy, camera = [], []
        for c, (h, w) in enumerate(self.sizes):
            xy.append(torch.stack([torch.arange(w).repeat(h), torch.arange(h).repeat_interleave(w)]) + 0.5)
            camera.append(torch.full((h * w,), c))
        self.xy, self.camera = torch.cat(xy, 1), torch.cat(camera)
        self._rays = None

    @property
    def rays(self) -> Tensor:
        """Rays [3, N] in the target's frame, with depth 1 in their own camera."""
        if self._rays is None:
            parts, m = [], torch.from_numpy(self.rays_of).float()
            for c in range(len(self.sizes)):
                xy = self.xy[:, self.base[c] : self.base[c + 1]]
                parts.append(torch.addmm(m[c, :, 2:], m[c, :, :2], xy))
            self._rays = torch.cat(parts, 1)
        return self._rays

    def point(self, x: float, y: float, disparity: float) -> np.ndarray:
        """Scene point at target pixel (x, y)."""
        return self.rays_of[0] @ [x, y, 1] / disparity

    def boxes(self, points: np.ndarray) -> np.ndarray:
        """Pixel boxes [M, C, 4] (x0, y0, x1, y1) around the hulls of points [M, P, 3]
        in every camera."""
        seen = np.einsum("cij,mpj->mcpi", self.r, points) + self.t[:, None]
        seen = np.einsum("cij,mcpj->mcpi", self.k, seen / np.maximum(seen[..., 2:], 0.05))[..., :2]
        limit = np.array([[w, h] for h, w in self.sizes])
        low = np.clip(np.floor(seen.min(2)) - 1, 0, limit)
        high = np.clip(np.ceil(seen.max(2)) + 1, 0, limit)
        return np.concatenate([low, np.maximum(high, low)], -1).astype(np.int64)

    def pixels(self, boxes: np.ndarray | None) -> tuple[Tensor | None, Tensor, np.ndarray]:
        """Flat pixel numbers [K] of boxes [M, C, 4] one after the other, the row m C + c [K] of
        each, and the number of pixels of each m."""
        if boxes is None:
            return None, self.camera, np.array([self.base[-1]])
        x0, y0, x1, y1 = boxes.reshape(-1, 4).T
        widths, counts = x1 - x0, (x1 - x0) * (y1 - y0)
        row = np.repeat(np.arange(len(counts)), counts)
        within = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
        down = within // widths[row]
        stride = np.array([w for _, w in self.sizes])
        camera = np.tile(np.arange(len(self.sizes)), len(boxes))
        start = np.array(self.base)[camera] + y0 * stride[camera] + x0
        pixels = start[row] + within + down * (stride[camera] - widths)[row]
        return torch.from_numpy(pixels), torch.from_numpy(row), counts.reshape(boxes.shape[:2]).sum(1)


@dataclass
class Fragments:
    """Part of a surface in all cameras: pixels [K] (None: all), colour [3, K], alpha and disparity
    [K] (1/z in the camera's own frame), its position in the order, and the range of disparity over
    which it intersects another softly."""

    order: float
    pixels: Tensor | None
    colour: Tensor
    alpha: Tensor
    disparity: Tensor
    soft: float
