"""Multiplane images at any camera: the volume of warped photos that they are made from, and their
view from elsewhere.

A target-centred image is composited directly; any other is first warped to the target, plane by
plane, by the plane's homography (paper, section "Preliminary Background")."""

import math

import torch
import torch.nn.functional as F
from torch import Tensor

from liveview_ref.reference.layers import normalised_grid, warp_views
from liveview_ref.reference.liveview import Camera, PlaneSweep, view_distances

from .method import Method, Photos, Predictor, Rendering

STRIDE = 16  # of the deepest network: sizes of multiplane images are multiples of it


class Mpi(Method):
    """One multiplane image by a network, built at the target or at the photo that
    `Photos.references` names first."""

    def __init__(self, predictor: Predictor, target_centred: bool):
        super().__init__()
        self.predictor, self.target_centred = predictor, target_centred

    def forward(self, photos: Photos, target: Camera, disparities: Tensor, cover: bool = True) -> Rendering:
        camera = self.camera_for(photos, target, disparities, cover)
        alpha, rgb = self.predictor(*volume_at(camera, photos, disparities))
        return self.rendering(alpha, rgb, camera, target, disparities)

    def batch(self, examples: list[tuple[Photos, Camera, Tensor]]) -> list[Rendering]:
        cameras = [self.camera_for(*example, cover=False) for example in examples]
        volumes = [volume_at(c, photos, planes) for c, (photos, _, planes) in zip(cameras, examples, strict=True)]
        made = zip(self.predictor.batch(volumes), cameras, examples, strict=True)
        return [self.rendering(*mpi, camera, target, planes) for mpi, camera, (_, target, planes) in made]

    def camera_for(self, photos: Photos, target: Camera, disparities: Tensor, cover: bool) -> Camera:
        """The camera at which the multiplane image is built."""
        if self.target_centred:
            return padded(target)
        return window(photos.cameras[photos.references[0]], target, disparities, cover)

    def rendering(self, alpha: Tensor, rgb: Tensor, camera: Camera, target: Camera, disparities: Tensor) -> Rendering:
        """The multiplane image of `camera`, seen from the target."""
        if self.target_centred:
            image = over(opaque_background(alpha), rgb)[:, : target.height, : target.width]
            valid = torch.ones(target.height, target.width, dtype=torch.bool)
        else:
            image, _, valid = view_of(alpha, rgb, camera, target, disparities)
        return Rendering(image, valid, alpha, camera)


def volume_at(camera: Camera, photos: Photos, disparities: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Photos on the planes of a camera: the input of a Predictor."""
    maps = disparities.float()[:, None, None].expand(-1, camera.height, camera.width)
    volume, coverage = warp_views(photos.images, photos.cameras, camera, maps)
    return volume, coverage, view_distances(photos.cameras, camera)


def padded(camera: Camera) -> Camera:
    """The camera, extended to the right and below to multiples of STRIDE."""
    return camera.with_window(0, 0, *(-(-length // STRIDE) * STRIDE for length in (camera.width, camera.height)))


def target_from_reference(reference: Camera, target: Camera, disparity: float) -> Tensor:
    """Homography of a plane at this disparity of the reference, [3, 3] float64: pixels to
    pixels."""
    return PlaneSweep.of(target, reference).source_from_target(disparity)


def window(reference: Camera, target: Camera, disparities: Tensor, cover: bool) -> Camera:
    """The window of the reference, beyond its photo where needed, that contains the target's
    view of the nearest and the farthest plane; without `cover`, a window of the target's size
    at its centre."""
    corners = torch.tensor([[x, y, 1.0] for x in (0, target.width) for y in (0, target.height)], dtype=torch.float64)
    seen = []
    for disparity in (float(disparities[0]), float(disparities[-1])):
        points = corners @ torch.linalg.inv(target_from_reference(reference, target, disparity)).T
        seen.append(points[:, :2] / points[:, 2:])
    low, high = torch.cat(seen).amin(0), torch.cat(seen).amax(0)
    if cover:
        left, top = (math.floor(x) - 1 for x in low.tolist())
        width, height = (math.ceil(x) + 1 - start for x, start in zip(high.tolist(), (left, top), strict=True))
    else:
        width, height = target.width, target.height
        left, top = (round(x - size / 2) for x, size in zip(((low + high) / 2).tolist(), (width, height), strict=True))
    return padded(reference.with_window(left, top, width, height))


def view_of(
    alpha: Tensor, rgb: Tensor, camera: Camera, target: Camera, disparities: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """A multiplane image [D, h, w], [D, 3, h, w] of `camera`, seen from the target: rgb [3, H, W]
    with the farthest plane made opaque, the opacity [H, W] of all planes without that, and which
    pixels every plane covers, [H, W] bool."""
    y, x = torch.meshgrid(torch.arange(target.height) + 0.5, torch.arange(target.width) + 0.5, indexing="ij")
    pixels = torch.stack([x, y, torch.ones_like(x)], -1)
    grids = []
    for disparity in disparities.tolist():
        reference_from_target = torch.linalg.inv(target_from_reference(camera, target, disparity)).float()
        points = (pixels[..., None, :] * reference_from_target).sum(-1)
        grids.append(normalised_grid(points[..., :2] / points[..., 2:], points[..., 2], camera.width, camera.height))
    planes = torch.cat([rgb, alpha[:, None]], 1)
    grid = torch.stack(grids).to(planes)
    warped = F.grid_sample(planes, grid, padding_mode="border", align_corners=False)
    within = (grid.abs() <= 1).all(-1)  # [D, H, W]
    colour, opacity = warped[:, :3], warped[:, 3] * within
    background = torch.cat([opacity[:-1], within[-1:].to(opacity)])
    return over(background, colour), 1 - (1 - opacity).prod(0), within.all(0)


def opaque_background(alpha: Tensor) -> Tensor:
    """Alpha [D, H, W] with an opaque farthest plane."""
    return torch.cat([alpha[:-1], torch.ones_like(alpha[-1:])])


def over(alpha: Tensor, rgb: Tensor) -> Tensor:
    """Planes composited, near to far: alpha [D, H, W], rgb [D, 3, H, W] -> [3, H, W]."""
    transmittance = torch.cumprod(torch.cat([torch.ones_like(alpha[:1]), 1 - alpha[:-1]]), 0)
    return ((transmittance * alpha)[:, None] * rgb).sum(0)
