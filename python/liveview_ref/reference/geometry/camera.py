"""Pinhole cameras and the relative pose between two of them, in float64."""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Camera:
    """k [3, 3] in pixels; rotation [3, 3] and translation [3] are cam_from_world; all float64."""

    k: Tensor
    rotation: Tensor
    translation: Tensor
    width: int
    height: int

    @property
    def centre(self) -> Tensor:
        """Camera centre in world units, [3]."""
        return -(self.rotation.T @ self.translation)

    @property
    def forward(self) -> Tensor:
        """Optical axis in the world, unit length, [3]."""
        return self.rotation[2]

    def with_size_scaled(self, width: int, height: int) -> "Camera":
        """The same camera for an image resampled to width x height."""
        scale = torch.diag(torch.tensor([width / self.width, height / self.height, 1.0], dtype=torch.float64))
        return Camera(scale @ self.k, self.rotation, self.translation, width, height)

    def shrunk(self, cell: int) -> "Camera":
        """The camera of a photo whose cells of cell x cell pixels are averaged, fewer at the right
        and lower edge."""
        width, height = -(-self.width // cell), -(-self.height // cell)
        return self.with_window(0, 0, width * cell, height * cell).with_size_scaled(width, height)

    def with_window(self, left: int, top: int, width: int, height: int) -> "Camera":
        """The same camera, looking at a window of its image."""
        shift = torch.tensor([[1.0, 0.0, -left], [0.0, 1.0, -top], [0.0, 0.0, 1.0]], dtype=torch.float64)
        return Camera(shift @ self.k, self.rotation, self.translation, width, height)


def source_from_target(source: Camera, target: Camera) -> tuple[Tensor, Tensor]:
    """Relative pose (R [3, 3], t [3]): X_source = R X_target + t."""
    rotation = source.rotation @ target.rotation.T
    return rotation, source.translation - rotation @ target.translation
