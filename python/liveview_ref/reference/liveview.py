"""LiveView (Ghosh et al., CVPR 2021) in plain torch, in the order of the paper's section 4.

A target picture is D planes of a multiplane image (MPI) at the target. For each plane the photos
are warped to the target (a homography warped volume, HWV), a network gives opacity and view
weights, the photos are blended, and the planes are composited front to back.

Cameras have OpenCV's axes (x right, y down, z forward), matrices are named result_from_input, and
the centre of the first pixel is (0.5, 0.5). Cameras are float64; everything else has the dtype of
the photos. Planes are given by disparity, 1 / depth, near -> far. What the paper leaves open is
said where it is decided.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from kornia.geometry.transform import homography_warp
from torch import Tensor, nn

STRIDE = 8  # the network halves its input three times
LARGEST = 1e6  # normalised source coordinates from here on are outside the photo

# --- 4, "Homography Warped Volume (HWV)": cameras, planes, the warp ---


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

    def with_window(self, left: int, top: int, width: int, height: int) -> "Camera":
        """The same camera, looking at a window of its image."""
        shift = torch.tensor([[1.0, 0.0, -left], [0.0, 1.0, -top], [0.0, 0.0, 1.0]], dtype=torch.float64)
        return Camera(shift @ self.k, self.rotation, self.translation, width, height)

    def shrunk(self, cell: int) -> "Camera":
        """The camera of a photo whose cells of cell x cell pixels are averaged, fewer at the right
        and lower edge."""
        width, height = -(-self.width // cell), -(-self.height // cell)
        return self.with_window(0, 0, width * cell, height * cell).with_size_scaled(width, height)


class PlaneSweep(NamedTuple):
    """The homographies of one view: for target pixel p = (x, y, 1) and disparity d,
    (u, v, w) = H_inf p + d e, with H_inf = K_s R K_t^-1 [3, 3] and e = K_s t [3], float64.

    The source pixel is (u / w, v / w), in front of the source where w > 0. Exact at d = 0, the
    plane at infinity, and 1 / d is never needed."""

    homography_at_infinity: Tensor
    epipole: Tensor

    @classmethod
    def of(cls, source: Camera, target: Camera) -> "PlaneSweep":
        """The sweep of `source` for `target`, with X_source = R X_target + t."""
        rotation = source.rotation @ target.rotation.T
        translation = source.translation - rotation @ target.translation
        return cls(source.k @ rotation @ torch.linalg.inv(target.k), source.k @ translation)

    def source_from_target(self, disparity: float) -> Tensor:
        """Source pixel from target pixel for the fronto-parallel plane of the target at this
        disparity, [3, 3]."""
        homography = self.homography_at_infinity.clone()
        homography[:, 2] += disparity * self.epipole
        return homography


def uniform_disparities(near: float, far: float, count: int) -> Tensor:
    """The paper's planes: `count` disparities, evenly spaced from 1/near to 1/far, near -> far, [D]
    float64. `far` may be inf."""
    if count == 1:
        return torch.tensor([0.5 / near + 0.5 / far], dtype=torch.float64)
    step = torch.arange(count, dtype=torch.float64) / (count - 1)
    return 1.0 / near + step * (1.0 / far - 1.0 / near)


def padded_size(height: int, width: int) -> tuple[int, int]:
    """Height and width rounded up to a multiple of the network's stride: the target is padded by
    what the photos show further out."""
    return -(-height // STRIDE) * STRIDE, -(-width // STRIDE) * STRIDE


def pixel_centres(height: int, width: int) -> Tensor:
    """(x, y, 1) of all pixels [3, H, W] float64."""
    y, x = torch.meshgrid(*(torch.arange(n, dtype=torch.float64) + 0.5 for n in (height, width)), indexing="ij")
    return torch.stack([x, y, torch.ones_like(x)])


def grid_from_pixels(width: int, height: int) -> Tensor:
    """[-1, 1] coordinates from pixels, [3, 3] float64."""
    return torch.tensor([[2 / width, 0, -1], [0, 2 / height, -1], [0, 0, 1]], dtype=torch.float64)


def with_coverage(image: Tensor) -> Tensor:
    """[3, H, W] -> [4, H, W]: adds an all-ones channel, whose sample is the coverage: how much of a
    bilinear sample lies in the photo, 0 to 1."""
    return torch.cat([image, torch.ones_like(image[:1])])


def kornia_samples(photo: Tensor, source: Camera, target: Camera, disparity: float, size: tuple[int, int]) -> Tensor:
    """A photo [3, Hs, Ws] on a plane of the target, size (height, width), by kornia's
    homography_warp: colour and coverage [4, H, W]; bilinear, zeros outside. kornia takes the
    homography from the target to the source, in normalised coordinates."""
    normal_source, normal_target = grid_from_pixels(source.width, source.height), grid_from_pixels(*size[::-1])
    homography = PlaneSweep.of(source, target).source_from_target(disparity)
    normalised = normal_source @ homography @ torch.linalg.inv(normal_target)
    return homography_warp(with_coverage(photo)[None], normalised[None].to(photo), size, align_corners=False)[0]


def warp(photo: Tensor, source: Camera, target: Camera, disparity: float) -> tuple[Tensor, Tensor]:
    """A photo [3, Hs, Ws] on a plane of the padded target: colour [3, H8, W8], coverage [H8, W8].

    kornia samples points behind the source camera (w <= 0) as if they were in front, which would
    show a mirrored ghost of the photo. These are outside, as are coordinates that are not finite or
    huge, whose samples are undefined.
    """
    size = padded_size(target.height, target.width)
    rgbc = kornia_samples(photo, source, target, disparity, size)
    normal_source = grid_from_pixels(source.width, source.height)
    homography = normal_source @ PlaneSweep.of(source, target).source_from_target(disparity)
    u, v, w = torch.tensordot(homography.to(photo), pixel_centres(*size).to(photo), 1)
    inside = (w > 0) & ((u / w).abs() < LARGEST) & ((v / w).abs() < LARGEST)
    rgbc = torch.where(inside, rgbc, 0.0)
    return rgbc[:3], rgbc[3]


def homography_warped_volume(
    photos: list[Tensor], cameras: list[Camera], target: Camera, disparities: Tensor
) -> tuple[Tensor, Tensor]:
    """Photos, nearest view first, on planes [n]: HWV [n, V, 3, H8, W8], coverage [n, V, H8, W8]."""
    views = list(zip(photos, cameras, strict=True))
    planes = [[warp(photo, camera, target, float(d)) for photo, camera in views] for d in disparities]
    hwv, coverage = (torch.stack([torch.stack([view[i] for view in plane]) for plane in planes]) for i in (0, 1))
    return hwv, coverage


# --- 4, "Neural Network": table 1 ---


def block(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    """Convolution, batch normalisation, ReLU."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, padding=1, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)
    )


class UNet(nn.Module):
    """HWV [n, 3V, H8, W8] -> logits [n, V, H8, W8]: of alpha, then of the weights of all views but
    the nearest. 391,680 convolution weights at V = 4."""

    def __init__(self, views: int):
        super().__init__()
        self.views = views
        self.conv1 = block(3 * views, 16)
        self.conv2 = block(16, 32, 2)
        self.conv3 = block(32, 64, 2)
        self.conv4 = block(64, 128, 2)
        self.conv5 = block(128, 128)
        self.ups5 = nn.Upsample(scale_factor=2.0, mode="bilinear")
        self.conv6 = block(192, 64)
        self.ups6 = nn.Upsample(scale_factor=2.0, mode="bilinear")
        self.conv7 = block(96, 32)
        self.ups7 = nn.Upsample(scale_factor=2.0, mode="bilinear")
        self.conv8 = block(48, 16)
        self.conv9 = nn.Conv2d(16, views, 3, padding=1)

    def forward(self, hwv: Tensor) -> Tensor:
        conv1 = self.conv1(hwv)
        conv2 = self.conv2(conv1)
        conv3 = self.conv3(conv2)
        conv5 = self.conv5(self.conv4(conv3))
        conv6 = self.conv6(torch.cat([self.ups5(conv5), conv3], 1))
        conv7 = self.conv7(torch.cat([self.ups6(conv6), conv2], 1))
        conv8 = self.conv8(torch.cat([self.ups7(conv7), conv1], 1))
        return self.conv9(conv8)


# --- 4, "Rendering the MPI": blend, composite ---


def view_distances(cameras: list[Camera], target: Camera) -> Tensor:
    """Distance of each camera centre to the target's, scene units, [V] float64."""
    return torch.stack([(c.centre - target.centre).norm() for c in cameras])


def distance_bias(distances: Tensor, power: float = 1.0) -> tuple[Tensor, Tensor]:
    """Distances [..., V] of the views to the target -> (power log(d_min / d_i) [..., V], coincident
    [..., V] bool).

    The paper normalises the weights by the distances d_i; as d_min / d_i this has no unit. Where
    the target coincides with a view (d = 0), that view takes all the weight at the pixels it
    covers; d_min is taken over the others, which contribute to the remaining pixels.
    """
    coincident = distances == 0
    nearest = distances.masked_fill(coincident, torch.inf).amin(-1, keepdim=True)
    # Of the quotient: scaling the scene by a power of two leaves every bit unchanged.
    bias = power * torch.log((nearest / distances).clamp_min(torch.finfo(distances.dtype).tiny))
    return bias.masked_fill(coincident, 0.0), coincident


def blend(
    logits: Tensor, colour: Tensor, coverage: Tensor, distances: Tensor, power: float = 1.0
) -> tuple[Tensor, Tensor]:
    """logits [n, V, H, W], HWV [n, V, 3, H, W], coverage [n, V, H, W], distances [V] or [n, V]
    -> alpha [n, H, W] (0 where no view covers the pixel), rgb [n, 3, H, W].

    The view weights are softmax(0, logit 1 .. logit V-1) d_min / d_i, normalised by coverage, so
    that a view that does not see a pixel does not darken it. In the log domain over the views that
    cover the pixel, so that neither extreme logits nor extreme distances give 0 / 0.
    """
    bias, coincident = distance_bias(distances.expand(len(logits), -1), power)
    eligible = coverage > 0
    covered = eligible.any(1)
    if bool(coincident.any()):
        coincident = coincident[:, :, None, None]
        on_top = (eligible & coincident).any(1, keepdim=True)
        eligible = eligible & (coincident == on_top)
    limits = torch.finfo(torch.float32)
    finite = logits.clamp(limits.min, limits.max)  # two infinite logits would give a NaN
    scores = torch.cat([torch.zeros_like(finite[:, :1]), finite[:, 1:]], 1) + bias.to(logits)[:, :, None, None]
    scores = scores.masked_fill(~eligible, -torch.inf)
    top = scores.amax(1, keepdim=True)
    weights = torch.exp(scores - top.masked_fill(~covered[:, None], 0.0))  # exp(-inf) = 0 where not eligible
    total = (weights * coverage).sum(1)
    rgb = (weights[:, :, None] * colour).sum(1) / torch.where(covered, total, torch.ones_like(total))[:, None]
    return torch.sigmoid(logits[:, 0]) * covered, rgb


@dataclass
class Composited:
    """rgb [3, H, W]; disparity [H, W] = sum T a d; transmittance [H, W] left behind the last plane;
    weights [D, H, W] = T a."""

    rgb: Tensor
    disparity: Tensor
    transmittance: Tensor
    weights: Tensor


def composite(alpha: Tensor, rgb: Tensor, covered: Tensor, maps: Tensor) -> Composited:
    """alpha [D, H, W], rgb [D, 3, H, W], near -> far, and disparities that broadcast to [D, H, W];
    covered [H, W]: whether any view covers the farthest plane, the background, whose alpha is then
    1. T_0 = 1, T_k+1 = T_k (1 - a_k), without an epsilon."""
    transmittance = torch.ones_like(alpha[0])
    weights = []
    last = len(alpha) - 1
    for k in range(len(alpha)):
        opacity = torch.where(covered, torch.ones_like(alpha[k]), alpha[k]) if k == last else alpha[k]
        weights.append(transmittance * opacity)
        transmittance = transmittance * (1 - opacity)
    weights = torch.stack(weights)
    return Composited((weights[:, None] * rgb).sum(0), (weights * maps).sum(0), transmittance, weights)


# --- 4, "Dynamic Plane Selection" ---


def plane_histogram(alpha: Tensor) -> Tensor:
    """alpha [D, H, W] -> number of pixels per plane [D]: each pixel votes for the plane with its
    largest alpha (ties: the nearer); a pixel that no plane covers (all alpha 0) does not vote."""
    best = alpha.argmax(0)
    best = best[alpha.amax(0) > 0]
    return torch.bincount(best, minlength=len(alpha))


def select_planes(histogram: Tensor, count: int) -> list[int]:
    """Indices of the `count` fullest bins (ties: the nearer), near -> far; all planes if there are
    no more than `count`. A video (5.4) renders its first frame on all planes, the rest on these."""
    order = sorted(range(len(histogram)), key=lambda k: (-int(histogram[k]), k))
    return sorted(order[:count])


# --- 4, "Overall Pipeline" ---

Network = Callable[[Tensor], Tensor]  # HWV [n, 3V, H8, W8] -> logits [n, V, H8, W8]


@dataclass
class Intermediates:
    """What a render computes on the way, over the padded target: colour (the HWV)
    [D, V, 3, H8, W8], coverage and logits [D, V, H8, W8], alpha [D, H8, W8], rgb [D, 3, H8, W8]."""

    colour: Tensor
    coverage: Tensor
    logits: Tensor
    alpha: Tensor
    rgb: Tensor


def render(
    network: Network, photos: list[Tensor], cameras: list[Camera], target: Camera, disparities: Tensor
) -> tuple[Composited, Intermediates]:
    """A picture on planes [D], near -> far, from V photos [3, Hs, Ws], nearest view first. It is
    cropped to the target's size; the intermediates are not."""
    distances = view_distances(cameras, target)
    planes = []
    for disparity in disparities.split(1):  # each plane by itself: the network sees no other
        colour, coverage = homography_warped_volume(photos, cameras, target, disparity)
        logits = network(colour.flatten(1, 2))
        planes.append((colour, coverage, logits, *blend(logits, colour, coverage, distances)))
    stages = Intermediates(*(torch.cat(x) for x in zip(*planes, strict=True)))
    covered = (stages.coverage[-1] > 0).any(0)
    full = composite(stages.alpha, stages.rgb, covered, disparities.to(stages.alpha)[:, None, None])
    crop = (..., slice(target.height), slice(target.width))
    return Composited(full.rgb[crop], full.disparity[crop], full.transmittance[crop], full.weights[crop]), stages
