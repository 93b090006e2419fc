"""Training on uniform planes, competing or independent, for configs with "shards", with gradients
through some of the planes.

All planes of an example pass through the network once without gradients; their weights and picture
give the loss and its gradient for each plane's logit 0 and colour. These gradients are propagated
through the network for some planes only, drawn by the size of their gradients and weighted by the
inverse of the probability to be drawn, so that the expectation is the gradient of all planes.
"""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..data.shards import Photos, Shards
from ..data.visibility import SEEN, UNKNOWN, partly_hidden, view_weights, weight_on_seen
from ..reference.competing import composite_competing, cover_planes
from ..reference.liveview import (
    Composited,
    PlaneSweep,
    UNet,
    blend,
    composite,
    plane_histogram,
    select_planes,
    uniform_disparities,
    view_distances,
)
from .precision import reduced_precision
from .validate import validate_planes

CHUNK = 16  # planes at a time through the network, as many as fit the cache

LEAST_SQUARE = 1e-4  # 40 dB


def warp_layers(photos: Photos, maps: Tensor) -> tuple[Tensor, Tensor]:
    """maps [L, H, W] (or [L, 1, 1]: planes) -> colour [L, V, 3, H, W], coverage [L, V, H, W]; like
    warp_views, from 8-bit photos."""
    height, width = photos.camera.height, photos.camera.width
    layers = len(maps)
    x, y = (torch.arange(n, dtype=torch.float64) + 0.5 for n in (width, height))
    colour, grid = torch.empty(layers, len(photos.views), 4, height, width), torch.empty(layers, height, width, 2)
    for v, (view, camera) in enumerate(zip(photos.views, photos.cameras, strict=True)):
        normal = torch.tensor([[2 / camera.width, 0, -1], [0, 2 / camera.height, -1], [0, 0, 1]], dtype=torch.float64)
        base, e = (normal @ term for term in PlaneSweep.of(camera, photos.camera))
        rays = (base[:, 0, None, None] * x + base[:, 1, None, None] * y[:, None] + base[:, 2, None, None]).float()
        e = e.float()
        w = rays[2] + maps * e[2]
        w = torch.where(w > 0, w, torch.full_like(w, 1e-9))  # far outside
        torch.div(rays[0] + maps * e[0], w, out=grid[..., 0])
        torch.div(rays[1] + maps * e[1], w, out=grid[..., 1])
        image = torch.cat([view.float() / 255, torch.ones(1, *view.shape[1:])])[None]
        sampled = torch.nn.functional.grid_sample(image, grid.reshape(1, -1, width, 2), align_corners=False)
        colour[:, v] = sampled.reshape(4, layers, height, width).transpose(0, 1)
    return colour[:, :, :3], colour[:, :, 3]


def image_loss(image: Tensor, truth: Tensor, counted: Tensor, config: dict) -> Tensor:
    """L1 plus half of the L1 of the image gradients, "square_weight" times the squared error, which
    PSNR measures, and "log_weight" times its logarithm, by which good and bad examples count alike,
    as in a mean of PSNR; images [3, H, W], over the pixels of a mask [H, W]."""
    difference = (image - truth) * counted
    dx = difference[..., 1:] - difference[..., :-1]
    dy = difference[..., 1:, :] - difference[..., :-1, :]
    square = (difference**2).mean()
    loss = difference.abs().mean() + 0.5 * (dx.abs().mean() + dy.abs().mean()) + config["square_weight"] * square
    return loss + config["log_weight"] * torch.log(square + LEAST_SQUARE)


def planes_for(rng: np.random.Generator, photos: Photos, config: dict) -> Tensor:
    near, far = photos.near * np.exp(rng.uniform(-0.2, 0.05)), photos.far * np.exp(rng.uniform(-0.05, 0.2))
    return uniform_disparities(near, far, int(rng.choice(config["uniform_planes"]))).float()[:, None, None]


def seen_range(weights: Tensor, planes: Tensor, photos: Photos) -> tuple[float, float]:
    """Between which depths the best planes of the pixels lie, 0.5 % of the pixels at each end left
    out, and one plane beyond; weights [L, H, W], planes [L, 1, 1] near -> far."""
    votes = plane_histogram(weights).cumsum(0)
    share = votes / votes[-1].clamp(min=1)
    first, last = (int(reached.int().argmax()) for reached in (share > 0.005, share >= 0.995))
    nearest, farthest = planes[max(first - 1, 0)], planes[min(last + 1, len(planes) - 1)]
    return max(photos.near, 1 / float(nearest)), min(photos.far, 1 / float(farthest))


def logits_of(net: UNet, colour: Tensor) -> Tensor:
    """Logits [L, V, H, W] float32 of planes whose warped views are [L, V, 3, H, W]."""
    parts = colour.flatten(1, 2).split(CHUNK)
    with reduced_precision():
        found = [net(part.contiguous(memory_format=torch.channels_last)) for part in parts]
    return torch.cat(found).float().contiguous()


EVEN = 0.15  # share of the probability that is the same for all layers


def draw_layers(mass: Tensor, count: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """`count` of the L layers, and the probability [count] with which each was drawn: a share EVEN
    is uniform, the rest proportional to the layers' mass [L], the size of their gradients.
    Systematic sampling: each layer at most once."""
    layers = len(mass)
    if count >= layers:
        return torch.arange(layers), torch.ones(layers)
    even = np.full(layers, 1 / layers)
    share = mass.double().numpy()
    share = share / share.sum() if share.sum() > 0 else even
    chance = count * (EVEN * even + (1 - EVEN) * share)
    while (chance > 1).any():  # certain layers are drawn once; the others share the remaining draws
        certain = chance >= 1
        left = count - certain.sum()
        chance = np.where(certain, 1.0, chance * left / chance[~certain].sum())
    order = rng.permutation(layers)
    edges = np.concatenate([[0.0], chance[order].cumsum()])
    at = np.minimum(rng.random() + np.arange(count), edges[-1] - 1e-9)
    ids = np.sort(order[np.searchsorted(edges, at, side="right") - 1])
    return torch.from_numpy(ids), torch.from_numpy(chance[ids]).float()


def example_loss(net: UNet, photos: Photos, rng: np.random.Generator, config: dict) -> tuple[Tensor, dict[str, float]]:
    """A value that has the gradient of the loss (in expectation, if there are more planes than
    "gradient_planes"), with its graph, and figures for the log."""
    distances = view_distances(photos.cameras, photos.camera).float()
    power = config["distance_power"]
    planes = planes_for(rng, photos, config)
    colour, coverage = warp_layers(photos, planes)
    known = photos.disparity is not None
    with torch.no_grad():
        logits = logits_of(net, colour)
    covered, ids = (coverage > 0).any(1), torch.arange(len(planes))
    parts = zip(*(x.split(CHUNK) for x in (logits, colour, coverage)), strict=True)
    rgb = torch.cat([blend(*part, distances, power)[1] for part in parts])
    selected = len(planes) > max(config["selected_planes"]) and rng.random() < config["selected"]
    if selected:  # as by the renderer
        few = int(rng.choice(config["selected_planes"]))
        ids = torch.tensor(select(logits[:, 0], rgb, covered, planes, few, config))
        planes, logits, rgb, covered = (x[ids] for x in (planes, logits, rgb, covered))
    logit0, rgb = logits[:, 0].clone().requires_grad_(), rgb.requires_grad_()
    loss, shown, figures = outcome(logit0, rgb, covered, planes, photos, config, not selected)
    if not (known or selected or photos.keeps_range):
        photos.keeps_range = True
        if rng.random() < config["seen_range"]:
            photos.near, photos.far = seen_range(shown.weights.detach(), planes, photos)
    gradients = torch.autograd.grad(loss, (logit0, rgb))
    # The effect of a plane's logits on the loss, by its alpha and by its colour, where views
    # differ by some 0.2.
    mass = sum(w * g.flatten(1).norm(dim=1) for w, g in zip((1.0, 0.2), gradients, strict=True))
    drawn, chance = draw_layers(mass, config["gradient_planes"], rng)
    ids = ids[drawn]
    colour, coverage = colour[ids], coverage[ids]
    extra = warp_layers(photos, photos.disparity[None]) if known else None  # a layer along the true surface
    found = logits_of(net, torch.cat([colour, extra[0]]) if known else colour)
    own = found[: len(ids), 0], blend(found[: len(ids)], colour, coverage, distances, power)[1]
    loss = torch.zeros(())
    for x, gradient in zip(own, gradients, strict=True):
        loss = loss + (x * gradient[drawn] / chance.reshape(-1, *[1] * (x.dim() - 1))).sum()
    if known:
        more, measured = view_loss(found[-1:], *extra, photos, shown.rgb.detach(), distances, power)
        loss, figures = loss + config["visible_weight"] * more, figures | measured
    return loss, figures


def select(logit0, rgb, covered, planes, few: int, config: dict) -> list[int]:
    """Indices of the planes that the renderer's select:K/D keeps."""
    if config["alpha"] == "competing":
        weights = composite_competing(logit0, rgb, covered, planes.expand_as(covered)).weights
        return cover_planes(plane_histogram(weights), few)
    return select_planes(plane_histogram(torch.sigmoid(logit0) * covered), few)


def outcome(logit0, rgb, covered, planes, photos: Photos, config: dict, whole: bool):
    """(loss, composite, figures for the log) of planes [L, 1, 1]; `whole`: all planes are given."""
    maps = planes.expand_as(covered)
    shown = composited(logit0, rgb, covered, planes, config)
    loss = image_loss(shown.rgb, photos.target.float() / 255, covered.any(0), config)
    figures = {"loss": float(loss.detach())}
    if whole and photos.disparity is not None:
        more, share = depth_loss(shown.weights, maps, photos)
        loss, figures = loss + config["depth_weight"] * more, figures | {"on surface": share, "surfaces": 1.0}
    return loss, shown, figures


def composited(logit0: Tensor, rgb: Tensor, covered: Tensor, planes: Tensor, config: dict) -> Composited:
    """The composite of the config's "alpha": competing planes, or the paper's composite."""
    maps = planes.expand_as(covered)
    if config["alpha"] == "competing":
        return composite_competing(logit0, rgb, covered, maps)
    return composite(torch.sigmoid(logit0) * covered, rgb, covered[-1], maps)


def depth_loss(weights: Tensor, maps: Tensor, photos: Photos) -> tuple[Tensor, float]:
    """Minus log of the weight of the planes next to the true surface, or within a pixel of parallax
    of it, where at least two views see it, because the picture alone gives hardly any gradient to a
    plane without weight; and the mean of that weight."""
    parallax = max(float(PlaneSweep.of(camera, photos.camera).epipole[:2].norm()) for camera in photos.cameras)
    reach = max(1.0 / parallax, 1.01 * float(maps[0, 0, 0] - maps[1, 0, 0]))
    near_by = (maps - photos.disparity).abs() <= reach
    where = (photos.seen == SEEN).sum(0) >= 2
    share = (weights * near_by).sum(0)
    mean = float(share.detach()[where].mean()) if bool(where.any()) else 0.0
    return -(torch.log(share.clamp(min=1e-4)) * where).mean(), mean


def view_loss(
    logits, colour, coverage, photos: Photos, image, distances, power: float
) -> tuple[Tensor, dict[str, float]]:
    """On the true surface: minus log of the weight on the views that see it, at pixels where
    another covering view is occluded; and figures for the log there."""
    seen = photos.seen.masked_fill(coverage[0] < 0.5, UNKNOWN)
    where = partly_hidden(seen)
    count = where.sum().clamp(min=64)
    share = weight_on_seen(view_weights(logits, coverage, distances, power)[0], seen)
    by_distance = weight_on_seen(view_weights(torch.zeros_like(logits), coverage, distances, power)[0], seen)
    figures = {}
    if bool(where.any()):
        error = ((image - photos.target.float() / 255) ** 2).mean(0)[where]
        figures = {
            "hidden pixels": float(where.sum()),
            "seen weight": float(share.detach()[where].sum()),
            "seen weight by distance": float(by_distance[where].sum()),
            "hidden error": float(error.sum()),
        }
    return -(torch.log(share.clamp(min=1e-6)) * where).sum() / count, figures


class Planes:
    """A fine_tune.Task. Examples are drawn from a window of shards that advances by one every
    "shard_every" steps."""

    def __init__(self, config: dict, data: Path, shards: Path):
        self.config, self.data = config, data
        self.shards, self.loaded = Shards(shards, config, data), {}

    def examples(self, step: int) -> list[Photos]:
        first = step // self.config["shard_every"]
        wanted = {(first + i) % self.config["shards"] for i in range(self.config["shards_at_once"])}
        self.loaded = {n: self.loaded[n] if n in self.loaded else self.shards[n] for n in sorted(wanted)}
        return [p for shard in self.loaded.values() for p in shard]

    def loss(self, net: UNet, example: Photos, rng: np.random.Generator) -> tuple[Tensor, dict[str, float]]:
        return example_loss(net, example, rng, self.config)

    def summary(self, figures: list[dict[str, float]]) -> str:
        def total(key: str) -> float:
            return sum(t.get(key, 0.0) for t in figures)

        hidden = max(total("hidden pixels"), 1.0)
        psnr = -10 * np.log10(max(total("hidden error") / hidden, 1e-9))
        seen, by_distance = total("seen weight") / hidden, total("seen weight by distance") / hidden
        text = f"loss {total('loss') / len(figures):.4f}; weight near the surface "
        text += f"{total('on surface') / max(total('surfaces'), 1):.3f}; where views are hidden: "
        return text + f"seen weight {seen:.3f} (by distance {by_distance:.3f}), {psnr:.2f} dB"

    def validate(self, net: UNet, file: Path) -> dict[str, float]:
        return validate_planes(net, self.config["validation"], self.data, file, self.config)
