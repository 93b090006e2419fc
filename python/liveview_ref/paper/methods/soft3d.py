"""Soft 3D Reconstruction (Penner and Zhang, SIGGRAPH Asia 2017), without learning: depth of each
photo by local matching, votes of all photos for surfaces (consensus), the resulting soft
visibility, a second round of matching that leaves out occluded neighbours, and the target
composited from consensus and visibility.

Volumes [C, D, H, W] are aligned with a photo, near to far; a plane of one camera is interpolated in
another's volume between its two neighbouring planes. The first round runs at half resolution. The
matching cost is that of this project's photo depth, smoothed by a guided filter as in Hosni et al.
(2013), instead of the publication's.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from liveview_ref.reference.layers import OUTSIDE, normalised_grid, source_coordinates, warp_maps
from liveview_ref.reference.liveview import Camera, PlaneSweep, grid_from_pixels, view_distances
from liveview_ref.reference.surface.photo_sweep import BEST_NEIGHBOURS, neighbour_cost

from .method import Method, Photos, Rendering

BATCH = 8  # planes at a time
RADIUS = 4  # of the guided filter, in pixels at half resolution
EPSILON = 1e-4  # of the guided filter: variance of colours that counts as flat
FAINT = 1e-4  # weight of occluded photos, and of the farthest plane, so that every pixel has a colour


class Soft3D(Method):
    """For any number of photos (at least two) and of planes at equal steps of disparity."""

    @torch.no_grad()
    def forward(self, photos: Photos, target: Camera, disparities: Tensor, cover: bool = True) -> Rendering:
        disparities = disparities.float()
        _, visibility = reconstructed(halved_photos(photos), [], disparities)
        votes, visibility = reconstructed(photos, visibility, disparities)
        rgb = rendered(photos, votes, visibility, target, disparities)
        return Rendering(rgb, torch.ones(target.height, target.width, dtype=torch.bool))


def halved_photos(photos: Photos) -> Photos:
    """The photos at half resolution."""
    images = [halved(image[None])[0] for image in photos.images]
    cameras = [c.with_size_scaled(i.shape[2], i.shape[1]) for c, i in zip(photos.cameras, images, strict=True)]
    return Photos(images, cameras, photos.references)


def reconstructed(photos: Photos, visibility: list[Tensor], disparities: Tensor) -> tuple[list[Tensor], list[Tensor]]:
    """A round of matching: votes [2, D, H, W] and soft visibility [1, D, H, W] of each photo, given
    the visibility of the previous round, if any, at any resolution."""
    guides = [GuidedFilter(image) for image in photos.images]
    votes = [vote(matching_costs(k, photos, visibility, disparities), guide) for k, guide in enumerate(guides)]
    surfaces = (consensus(votes, photos.cameras, camera, disparities) for camera in photos.cameras)
    return votes, [before(surface)[None] for surface in surfaces]


class GuidedFilter:
    """A guided filter (He et al., 2010) that keeps the edges of a photo [3, H, W]; its coefficients
    are computed at half resolution."""

    def __init__(self, image: Tensor):
        self.image, self.small = image, halved(image[None])
        self.mean = box(self.small)
        products = box((self.small[:, :, None] * self.small[:, None]).flatten(1, 2)).unflatten(1, (3, 3))
        covariance = products - self.mean[:, :, None] * self.mean[:, None]
        regular = covariance.permute(0, 3, 4, 1, 2) + EPSILON * torch.eye(3)
        self.inverse = torch.linalg.inv(regular).permute(0, 3, 4, 1, 2)  # [1, 3, 3, h, w]

    def __call__(self, planes: Tensor) -> Tensor:
        """[D, H, W] -> [D, H, W]"""
        return torch.cat([self.filtered(part) for part in planes.split(BATCH)])

    def filtered(self, planes: Tensor) -> Tensor:
        values = halved(planes[:, None])
        mean = box(values)
        covariance = box(values * self.small) - mean * self.mean
        slope = (self.inverse * covariance[:, None]).sum(2)
        offset = mean - (slope * self.mean).sum(1, keepdim=True)
        lines = F.interpolate(box(torch.cat([slope, offset], 1)), planes.shape[1:], mode="bilinear")
        return (lines[:, :3] * self.image).sum(1) + lines[:, 3]


def halved(x: Tensor) -> Tensor:
    return F.avg_pool2d(x, 2, ceil_mode=True, count_include_pad=False)


def box(x: Tensor) -> Tensor:
    """Mean over the window inside the image, [N, C, h, w]."""
    for kernel, padding in (((1, 2 * RADIUS + 1), (0, RADIUS)), ((2 * RADIUS + 1, 1), (RADIUS, 0))):
        x = F.avg_pool2d(x, kernel, 1, padding, count_include_pad=False)
    return x


def looked_up(volume: Tensor, source: Camera, camera: Camera, disparities: Tensor, plane: int) -> Tensor:
    """A plane of `camera` in a volume [C, D, h, w] of `source`: [C, H, W], 0 outside its photo."""
    sweep, last, here = PlaneSweep.of(source, camera), len(disparities) - 1, disparities[plane]
    homography = sweep.source_from_target(float(here))
    if homography[2].equal(homography.new_tensor([0.0, 0.0, 1.0])):  # parallel cameras share their planes
        flat = (grid_from_pixels(source.width, source.height) @ homography).float()
        grid = pixel_centres(camera) @ flat[:2].T
        return F.grid_sample(volume[None, :, plane], grid[None], align_corners=False)[0]
    points, w = source_coordinates(sweep, here.expand(camera.height, camera.width))
    # depth there is w times depth here
    index = (disparities[0] - here / w) / ((disparities[0] - disparities[-1]) / max(last, 1))
    depth = (index.clamp(0, last) + 0.5) / (last + 1) * 2 - 1
    depth = torch.where((index < -0.5) | (index > last + 0.5), OUTSIDE, depth)
    grid = torch.cat([normalised_grid(points, w, source.width, source.height), depth[..., None]], -1)
    return F.grid_sample(volume[None], grid[None, None], align_corners=False)[0, :, 0]


def pixel_centres(camera: Camera) -> Tensor:
    """(x, y, 1), [H, W, 3]"""
    y, x = torch.meshgrid(torch.arange(camera.height) + 0.5, torch.arange(camera.width) + 0.5, indexing="ij")
    return torch.stack([x, y, torch.ones_like(x)], -1)


def matching_costs(k: int, photos: Photos, visibility: list[Tensor], disparities: Tensor) -> Tensor:
    """Costs of the planes of photo k, [D, H, W]: the mean over the neighbours that match best, or
    over all weighted by their visibility [1, D, H, W] if it is known."""
    image, camera = photos.images[k], photos.cameras[k]
    neighbours = [i for i in range(len(photos.images)) if i != k]
    result = []
    for planes in torch.arange(len(disparities)).split(BATCH):
        maps = disparities[planes][:, None, None].expand(-1, camera.height, camera.width)
        costs = [neighbour_cost(image, camera, photos.images[i], photos.cameras[i], maps, 1) for i in neighbours]
        costs = torch.stack(costs)
        best = costs.sort(0).values[:BEST_NEIGHBOURS].mean(0)
        if visibility:
            pairs = [(visibility[i], photos.cameras[i]) for i in neighbours]
            weights = torch.stack(
                [torch.cat([looked_up(*pair, camera, disparities, p) for p in planes.tolist()]) for pair in pairs]
            )
            best = ((weights * costs).sum(0) + FAINT * best) / (weights.sum(0) + FAINT)
        result.append(best)
    return torch.cat(result)


def vote(costs: Tensor, guide: GuidedFilter) -> Tensor:
    """A photo's votes [2, D, H, W] from its costs: for a surface at each point, and for the point
    being visible, both smoothed between the photo's edges."""
    depth = guide(costs).argmin(0)
    surface = guide((depth == torch.arange(len(costs))[:, None, None]).float()).clamp(0, 1)
    return torch.stack([surface, before(surface)])


def before(surface: Tensor) -> Tensor:
    """Soft visibility: the transmittance of a ray in front of each plane of [D, H, W]."""
    return (1 - surface.cumsum(0) + surface).clamp(0, 1)


def consensus(votes: list[Tensor], sources: list[Camera], camera: Camera, disparities: Tensor) -> Tensor:
    """Surface at each point of the camera's planes, [D, H, W]: the share of votes among the photos
    that see it."""
    planes = []
    for plane in range(len(disparities)):
        pairs = zip(votes, sources, strict=True)
        surface, seen = sum(looked_up(vote, source, camera, disparities, plane) for vote, source in pairs)
        planes.append(surface / seen.clamp_min(0.01))
    return torch.stack(planes)


def rendered(photos: Photos, votes: list[Tensor], visibility: list[Tensor], target: Camera, disparities: Tensor):
    """The target [3, H, W]: on each plane the mean of the photos that see it, weighted by nearness;
    planes from near to far until their consensus fills the pixel."""
    surfaces = consensus(votes, photos.cameras, target, disparities)
    surfaces[-1] += FAINT
    shares = torch.minimum(surfaces, before(surfaces))
    nearness = view_distances(photos.cameras, target).clamp_min(1e-6) ** -2
    nearness = (nearness / nearness.sum()).float()
    rgb = torch.zeros(3, target.height, target.width)
    for plane, share in enumerate(shares):
        maps = disparities[plane].expand(1, target.height, target.width)
        colour = weight = FAINT**2
        for k, (image, camera) in enumerate(zip(photos.images, photos.cameras, strict=True)):
            seen = looked_up(visibility[k], camera, target, disparities, plane)[0]
            warped, coverage = warp_maps(image, camera, target, maps)
            own = nearness[k] * (seen + FAINT)
            colour, weight = colour + own * warped[0], weight + own * coverage[0]
        rgb += share * colour / weight
    return rgb / shares.sum(0)


def soft3d(views: int) -> Soft3D:
    """The same method for any number of photos."""
    return Soft3D()
