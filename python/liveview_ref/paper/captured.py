"""Scenes of the paper's own data sets, with what a RigScene offers: photos, targets and planes."""

from dataclasses import dataclass

import torch
from torch import Tensor

from ..reference.geometry.camera import Camera
from ..reference.layers.uniform import uniform_disparities
from .method import Photos


@dataclass
class CapturedScene:
    """Photos [3, H, W] uint8 of one number of views and the targets between them, whose sizes may differ; `disparities`
    [H, W] (1/scene unit) of the targets where the data has them, else zeros, which no loss may use; depths of the scene
    lie between near and far (scene units)."""

    name: str
    images: list[Tensor]
    cameras: list[Camera]
    references: tuple[int, ...]
    places: list[str]  # names of the targets
    target_images: list[Tensor]
    target_cameras: list[Camera]
    disparities: list[Tensor] | None
    near: float
    far: float

    def target(self, index: int) -> tuple[Camera, Tensor, Tensor]:
        """Its camera, image [3, H, W] in [0, 1] and disparity [H, W]."""
        image = self.target_images[index].float() / 255
        disparity = torch.zeros(image.shape[1:]) if self.disparities is None else self.disparities[index]
        return self.target_cameras[index], image, disparity

    def photos(self, views: int) -> Photos:
        """The photos; `views` is their number."""
        if views != len(self.images):
            raise ValueError(f"{self.name} was opened for {len(self.images)} views, not {views}")
        return Photos([image.float() / 255 for image in self.images], self.cameras, self.references)

    def planes(self, count: int) -> Tensor:
        """Equi-disparity planes over the scene's depths, near to far, [D] float64."""
        return uniform_disparities(self.near, self.far, count)
