"""Baselines of the evaluation: renderers without a network, from the same views. Each yields (name,
image [3, H, W]); pixels that no view covers are black."""

import torch
import torch.nn.functional as F
from torch import Tensor

from ..data.held_out import INNER, Case
from ..layer_spec import Planes
from ..reference.guided import layer_costs
from ..reference.layers import warp_views
from ..reference.liveview import Camera
from ..reference.metrics import psnr
from .methods import BATCH, PLANES, guided_maps_of, maps_of

WINDOW = 5  # pixels over which the sweep averages the variance


def nearest(case: Case):
    """The photo of the nearest view, resampled if its size differs."""
    size = (case.target.height, case.target.width)
    yield "nearest view", F.interpolate(case.sources[0][None], size, mode="bilinear", antialias=True)[0].clamp(0, 1)


def mean_of_views(case: Case, maps: Tensor) -> tuple[Tensor, Tensor]:
    """Mean colour [L, 3, H, W] of the views that cover the layers [L, H8, W8], and whether any does
    [L, 1, H, W]."""
    colour, coverage = warp_views(case.sources, case.cameras, case.target, maps)
    total = coverage.sum(1, keepdim=True)
    mean = colour.sum(1) / torch.where(total > 0, total, torch.ones_like(total))
    crop = (..., slice(case.target.height), slice(case.target.width))
    return mean[crop], total[crop] > 0


def single_plane(case: Case):
    """The mean of the views on the best of 64 planes, chosen by PSNR against the truth: an upper
    bound for any choice of a single plane."""
    images = (
        image for part in maps_of(case, Planes(PLANES[-1])).split(BATCH) for image in mean_of_views(case, part)[0]
    )
    yield "best single plane", max(images, key=lambda image: psnr(image[INNER], case.truth[INNER]))


def winning(case: Case, maps: Tensor) -> Tensor:
    """Image of the winner-takes-all plane sweep: at each pixel the layer [L, H8, W8] on which the
    views agree best over a window (ties: the nearer), with the mean colour of the views that cover
    it; the last layer where none does."""
    best, cheapest = maps[0], torch.full_like(maps[0], torch.inf)
    for part in maps.split(BATCH):
        for layer, cost in zip(part, layer_costs(*case[:3], part, 1, WINDOW), strict=True):
            best, cheapest = torch.where(cost < cheapest, layer, best), torch.minimum(cost, cheapest)
    image, seen = mean_of_views(case, best[None])
    return torch.where(seen, image, mean_of_views(case, maps[-1:])[0])[0]


def sweep(case: Case):
    """The windowed-variance sweep over 64 uniform planes, and over the network's guided layers."""
    planes = Planes(PLANES[-1])
    for name, maps in {str(planes): maps_of(case, planes), **guided_maps_of(case)}.items():
        yield f"sweep, {name}", winning(case, maps)


def flanking(cameras: list[Camera], target: Camera) -> tuple[int, int, float]:
    """The two nearest views with the target between them (an angle above 90 degrees), else the two
    nearest; and the position of the target's projection on the line from the first to the second,
    in [0, 1]."""
    to = [c.centre - target.centre for c in cameras]  # nearest first
    pairs = [(i, j) for j in range(len(to)) for i in range(j)]
    pairs.sort(key=lambda p: float(to[p[0]].norm() + to[p[1]].norm()))
    i, j = next((p for p in pairs if float(to[p[0]] @ to[p[1]]) < 0), (0, 1))
    line = to[j] - to[i]
    return i, j, float((-to[i] @ line / (line @ line).clamp(min=1e-12)).clamp(0, 1))


def flow(case: Case):
    """Interpolation of two photos by OpenCV's DIS optical flow. It needs no depth, and is correct
    only if the target's centre lies on the line between the two views.

    Both photos are first warped to the target's orientation by the plane at the middle disparity,
    so that the remaining motion is linear along that line. Flow in both directions is scaled to the
    target's fraction t of the line as in Super SloMo (Jiang et al. 2018, equation 4), followed by a
    backward warp and a blend by 1 - t and t over the pixels that each covers."""
    cv2 = opencv()
    i, j, t = flanking(case.cameras, case.target)
    views, cameras = ([x[i], x[j]] for x in case[:2])
    colour, coverage = (x[0] for x in warp_views(views, cameras, case.target, maps_of(case, Planes(1))))
    # Rounds halves to even, as for the reported scores; to_u8 rounds them up, which changes one
    # score by 2e-5 dB.
    grey = [(x.mean(0) * 255).round().byte().numpy() for x in colour]
    dis = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    there, back = (torch.from_numpy(dis.calc(*pair, None)).permute(2, 0, 1) for pair in (grey, grey[::-1]))
    first, second = torch.cat([colour, coverage[:, None]], 1)  # [4, H8, W8] each
    first = displaced(first, -t * (1 - t) * there + t * t * back)
    second = displaced(second, (1 - t) ** 2 * there - t * (1 - t) * back)
    both = (1 - t) * first + t * second
    image = both[:3] / torch.where(both[3:] > 0, both[3:], torch.ones_like(both[3:]))
    yield "DIS flow", image[:, : case.target.height, : case.target.width].clamp(0, 1)


def opencv():
    try:
        import cv2
    except ImportError as error:
        raise ModuleNotFoundError("DIS flow needs opencv-python-headless: make setup WITH=evaluation") from error
    return cv2


def displaced(image: Tensor, offset: Tensor) -> Tensor:
    """Sample [C, H, W] at each pixel plus its offset (x, y) [2, H, W], zeros outside."""
    height, width = image.shape[1:]
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    grid = torch.stack([(x + offset[0]) / width, (y + offset[1]) / height], -1) * 2 - 1
    return F.grid_sample(image[None], grid[None], align_corners=False)[0]
