"""Local Light Field Fusion (Mildenhall et al., SIGGRAPH 2019): multiplane images of several photos,
each rendered at the target and blended there by distance and opacity (its section "Reconstructing
novel views by blending"). Nothing is trained here: the network is that of the local light field, as
in the paper."""

import torch
from torch import Tensor

from liveview_ref.reference.liveview import Camera

from .local_light_field import LocalLightField
from .method import Method, Photos, Predictor, Rendering
from .mpi import view_of, volume_at, window


class LightFieldFusion(Method):
    """One multiplane image for each of `Photos.references`, from this photo and those before the
    next reference."""

    def __init__(self, predictor: Predictor):
        super().__init__()
        self.predictor = predictor

    def forward(self, photos: Photos, target: Camera, disparities: Tensor, cover: bool = True) -> Rendering:
        seen = []
        for group in groups(photos):
            camera = window(group.cameras[0], target, disparities, cover)
            alpha, rgb = self.predictor(*volume_at(camera, group, disparities))
            seen.append(view_of(alpha, rgb, camera, target, disparities))
        images, opacities, valid = (torch.stack(parts) for parts in zip(*seen, strict=True))
        weights = fusion_weights([photos.cameras[i] for i in photos.references], target, disparities)
        return Rendering(fused(images, opacities, weights), valid.all(0))


def light_field_fusion(views: int) -> LightFieldFusion:
    """The fusion of two local light fields, each of half of the photos, with the same weights."""
    return LightFieldFusion(LocalLightField(views // 2))


def groups(photos: Photos) -> list[Photos]:
    """The photos from each reference to the next, each group's reference first."""
    starts = [*photos.references, len(photos.images)]
    if starts[0] != 0 or starts != sorted(set(starts)):
        raise ValueError(f"references: {photos.references}; expected increasing indices that begin with 0")
    spans = [slice(*pair) for pair in zip(starts[:-1], starts[1:], strict=True)]
    return [Photos(photos.images[span], photos.cameras[span], (0,)) for span in spans]


def fusion_weights(references: list[Camera], target: Camera, disparities: Tensor) -> Tensor:
    """exp(-f l / (D z_near)) for references at distance l from the target: [K] float32,
    summing to 1."""
    falloff = float(target.k[0, 0] * disparities[0]) / len(disparities)
    distances = torch.stack([(camera.centre - target.centre).norm() for camera in references])
    return torch.softmax(-falloff * distances, 0).float()


def fused(images: Tensor, opacities: Tensor, weights: Tensor) -> Tensor:
    """images [K, 3, H, W], opacities [K, H, W], weights [K] -> [3, H, W]: the mean weighted by
    weight times opacity; by weight alone where nothing is opaque."""
    shares = weights[:, None, None] * opacities.clamp_min(1e-6)
    return (shares[:, None] * images).sum(0) / shares.sum(0)
