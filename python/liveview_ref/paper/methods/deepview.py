"""DeepView (Flynn et al., CVPR 2019), small: a multiplane image at the centre of the photos by
learned gradient descent.

One network initialises the image from the photos on its planes. Further networks, one for each
step, correct it from the components of the gradient of any loss of the rendered photos (its section
3.3): for each photo the image rendered in its place, and on every plane the accumulated colour
behind it and its transmittance. The networks see one plane at a time, share their weights over
planes and views, and pool over views by the maximum.

Reduced: two steps instead of three, 8 to 32 channels, no gradient through the components of the
gradient, colours initialised with the mean of the photos, and at most 32 planes in training.
"""

import math
from collections.abc import Iterable

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from liveview_ref.reference.layers import outside_masked
from liveview_ref.reference.liveview import Camera, grid_from_pixels

from .method import Method, Photos, Rendering
from .mpi import opaque_background, target_from_reference, view_of, volume_at, window

STEPS = 2  # of gradient descent, after the initialisation
WIDTH = 8
BATCH = 8  # planes per pass of a network outside training
COMPONENTS = 7  # of the gradient, per photo and plane: the rendered image, the colour behind the plane, transmittance


def block(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(inputs, outputs, 3, stride, padding=1), nn.ReLU(inplace=True))


class Step(nn.Module):
    """A change of colour and alpha before their sigmoids, [D, 4, H, W], from the features of each
    photo on the planes."""

    def __init__(self, inputs: int, width: int = WIDTH):
        super().__init__()
        self.inputs = inputs
        self.per_view = block(inputs + 4, width)
        self.per_view_half = block(width, 2 * width, 2)
        self.pooled_half = nn.Sequential(block(2 * width, 4 * width), block(4 * width, 4 * width))
        self.pooled_full = block(5 * width + 4, 2 * width)
        self.out = nn.Conv2d(2 * width, 4, 3, padding=1)
        with torch.no_grad():
            self.out.weight.mul_(0.1)
            self.out.bias.zero_()
        self.to(memory_format=torch.channels_last)

    def shared(self, planes: Tensor) -> Tensor:
        """The part of the first convolution that all views share: of the multiplane image
        [D, 4, H, W]."""
        return F.conv2d(channels_last(planes), self.per_view[0].weight[:, self.inputs :], padding=1)

    def features(self, view: Tensor, shared: Tensor) -> tuple[Tensor, Tensor]:
        """Features of one view [D, inputs, H, W] with the shared part, at full and half
        resolution."""
        first = self.per_view[0]
        full = F.relu(F.conv2d(channels_last(view), first.weight[:, : self.inputs], first.bias, padding=1) + shared)
        return full, self.per_view_half(full)

    def change(self, full: Tensor, half: Tensor, planes: Tensor) -> Tensor:
        """Features pooled over the views -> [D, 4, H, W]."""
        up = F.interpolate(self.pooled_half(half), scale_factor=2.0)
        return self.out(self.pooled_full(channels_last(torch.cat([up, full, planes], 1)))).float()

    def forward(self, views: Iterable[tuple[Tensor, ...]], planes: Tensor) -> Tensor:
        """views: per photo, tensors [D, c, H, W] with `inputs` channels in total, generated on
        demand, so that only one photo's are in memory at a time."""
        size = len(planes) if torch.is_grad_enabled() else BATCH
        parts = planes.split(size)
        shared = [self.shared(part) for part in parts]
        pooled: list[tuple[Tensor, Tensor]] = []
        for view in views:
            for index, parts_of_view in enumerate(zip(*(tensor.split(size) for tensor in view), strict=True)):
                full, half = self.features(torch.cat(parts_of_view, 1), shared[index])
                if len(pooled) == index:
                    pooled.append((full, half))
                else:
                    pooled[index] = larger(pooled[index][0], full), larger(pooled[index][1], half)
        return torch.cat([self.change(*pool, part) for pool, part in zip(pooled, parts, strict=True)])


def larger(a: Tensor, b: Tensor) -> Tensor:
    """The maximum; its gradient costs a third of torch.maximum's."""
    return a + F.relu(b - a)


def channels_last(x: Tensor) -> Tensor:
    return x.contiguous(memory_format=torch.channels_last)


class DeepView(Method):
    """Takes any number of photos and of planes."""

    def __init__(self, steps: int = STEPS, width: int = WIDTH):
        super().__init__()
        self.start = Step(4, width)
        self.steps = nn.ModuleList(Step(4 + COMPONENTS, width) for _ in range(steps))

    def forward(self, photos: Photos, target: Camera, disparities: Tensor, cover: bool = True) -> Rendering:
        camera = window(middle(photos.cameras), target, disparities, cover)
        colour, coverage, _ = volume_at(camera, photos, disparities)
        seen = torch.cat([colour, coverage[:, :, None]], 2)  # [D, V, 4, H, W]
        del colour, coverage
        planes = start(seen)
        planes = planes + self.start(zip(seen.unbind(1), strict=True), torch.sigmoid(planes))
        frames = [window(photo, camera, disparities, cover) for photo in photos.cameras]
        for step in self.steps:
            now = torch.sigmoid(planes)
            gradients = (components(now, camera, frame, disparities) for frame in frames)
            planes = planes + step(zip(seen.unbind(1), gradients, strict=True), now)
        rgb, alpha = torch.sigmoid(planes).split([3, 1], 1)
        image, _, valid = view_of(alpha[:, 0], rgb, camera, target, disparities)
        return Rendering(image, valid, alpha[:, 0], camera)


def middle(cameras: list[Camera]) -> Camera:
    """The first camera, moved to the mean of the cameras' centres."""
    first = cameras[0]
    centre = torch.stack([camera.centre for camera in cameras]).mean(0)
    return Camera(first.k, first.rotation, -(first.rotation @ centre), first.width, first.height)


def start(seen: Tensor) -> Tensor:
    """Colours [D, V, 3 + coverage, H, W] -> [D, 4, H, W] before the sigmoid: their mean, and alpha
    1 / D."""
    mean = seen[:, :, :3].sum(1) / seen[:, :, 3:].sum(1).clamp_min(1e-3)
    alpha = torch.full_like(mean[:, :1], -math.log(max(len(seen) - 1, 1)))
    return torch.cat([torch.logit(mean, 0.01), alpha], 1)


@torch.no_grad()
def components(planes: Tensor, camera: Camera, photo: Camera, disparities: Tensor) -> Tensor:
    """Components of a photo's gradient on the planes [D, 4, h, w] of `camera`:
    [D, COMPONENTS, h, w], aligned with them."""
    there = torch.stack([target_from_reference(camera, photo, d) for d in disparities.tolist()])
    at_photo = sampled(planes, torch.linalg.inv(there), photo)
    rgb, alpha = at_photo[:, :3], opaque_background(at_photo[:, 3])
    passed = torch.cumprod(torch.cat([torch.ones_like(alpha[:1]), 1 - alpha[:-1]]), 0)
    light = ((passed * alpha)[:, None] * rgb).cumsum(0)  # from the nearest plane to this one
    del at_photo, rgb
    image = light[-1:].clone()
    behind = light.neg_().add_(image).div_((passed * (1 - alpha)).clamp_min(1e-3)[:, None])
    parts = [
        sampled(torch.cat([image.expand_as(b), b, p[:, None]], 1), h, camera)
        for b, p, h in zip(behind.split(BATCH), passed.split(BATCH), there.split(BATCH), strict=True)
    ]
    return torch.cat(parts)


def sampled(planes: Tensor, source_from_camera: Tensor, camera: Camera) -> Tensor:
    """Each of the planes [D, C, h, w] at the pixels of a camera, by its homography
    [D, 3, 3]; 0 outside."""
    y, x = torch.meshgrid(torch.arange(camera.height) + 0.5, torch.arange(camera.width) + 0.5, indexing="ij")
    unit = (grid_from_pixels(planes.shape[3], planes.shape[2]) @ source_from_camera).float()[:, None, None]
    parts = []
    for part, h in zip(planes.split(BATCH), unit.split(BATCH), strict=True):
        # not a matrix product, which autocast would round
        points = h[..., 0] * x[..., None] + h[..., 1] * y[..., None] + h[..., 2]
        grid = outside_masked(points[..., :2] / points[..., 2:], points[..., 2])
        parts.append(F.grid_sample(part, grid, align_corners=False))
    return torch.cat(parts)


def deepview(views: int) -> DeepView:
    """The same network for any number of photos."""
    return DeepView()
