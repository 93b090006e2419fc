"""The loss of a crop on surface layers: the error relative to weights by distance, and the weight
on the views that truly see the surface."""

import math
from dataclasses import replace

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..data.surface_frames import SurfaceFrame
from ..data.visibility import UNKNOWN, partly_hidden
from ..evaluation.view_weights import view_weights, weight_on_seen
from ..reference.composite import composite
from ..reference.render.blend import VISIBLE_POWER, blend
from ..reference.unet import UNet

CELL = 16  # pixels
FLOOR = 1e-4, 0.005  # least squared and absolute error, 40 dB
SHARES = 0.65, 0.35  # of squared and absolute error in the loss


def interest(frame: SurfaceFrame, crop: list[int]) -> np.ndarray:
    """Probabilities of crops by their position in cells of CELL pixels: proportional to the share
    of pixels where a view is occluded or differs from the truth, plus a constant."""
    colour, shown = frame.colour[0].float(), frame.shown[0]
    error = (colour - frame.target.float()).abs().amax(1)  # of the channels, [V, H, W]
    teaches = ((shown == 0) | (error > 25)).any(0).float()
    score = F.avg_pool2d(teaches[None, None], tuple(crop), CELL)[0, 0]
    score = score + 0.3 * score.mean() + 1e-3
    return (score / score.sum()).numpy()


def crop_of(frame: SurfaceFrame, chances: np.ndarray, rng: np.random.Generator, config: dict) -> SurfaceFrame:
    """A crop, randomly flipped or transposed."""
    top, left = (CELL * int(i) for i in divmod(int(rng.choice(chances.size, p=chances.ravel())), chances.shape[1]))
    top += int(rng.integers(min(CELL, frame.target.shape[1] - top - config["crop"][0] + 1)))
    left += int(rng.integers(min(CELL, frame.target.shape[2] - left - config["crop"][1] + 1)))
    window = (..., slice(top, top + config["crop"][0]), slice(left, left + config["crop"][1]))
    axes = [axis for axis in (-1, -2) if rng.random() < 0.5]
    turn = rng.random() < 0.5

    def cut(x: Tensor | None) -> Tensor | None:
        if x is None:
            return None
        x = x[window].flip(axes)
        return x.transpose(-1, -2) if turn else x

    maps = (cut(x) for x in (frame.colour, frame.coverage, frame.shown, frame.target))
    return SurfaceFrame(*maps, frame.distances, cut(frame.seen))


def recoloured(crop: SurfaceFrame, rng: np.random.Generator) -> SurfaceFrame:
    """The crop with other colours, the same in all views and the truth, because the few real scenes
    must not be recognised by their colours."""
    order = torch.from_numpy(rng.permutation(3))
    gain, lift = np.exp(rng.normal(0, 0.2, 3)), rng.normal(0, 0.06)
    table = torch.arange(256)[None] / 255 * torch.from_numpy(gain)[:, None] + lift  # per channel
    table = (table.clamp(0, 1) * 255).round().to(torch.uint8)

    def other(x: Tensor) -> Tensor:
        channels = x[..., order, :, :].unbind(-3)
        return torch.stack([row[c.long()] for row, c in zip(table, channels, strict=True)], -3)

    colour = torch.where(crop.coverage[:, :, None] == 255, other(crop.colour), crop.colour)  # borders fade to black
    return replace(crop, colour=colour, target=other(crop.target))


def masks(frame: SurfaceFrame, rng: np.random.Generator, config: dict) -> Tensor:
    """The masks of the views [L, V, H, W]: those of the program, or without half of a view, or
    none, or wrong in places."""
    shown, chance = frame.shown.float(), rng.random()
    if rng.random() < config["cut"]:  # a view whose photo ends there
        v, axis = int(rng.integers(shown.shape[1])), int(rng.integers(2))
        length = shown.shape[2 + axis]
        start, size = (0, int(rng.integers(length))) if rng.random() < 0.5 else (int(rng.integers(length)), length)
        shown = shown.clone()
        shown[:, v].narrow(1 + axis, start, min(size, length - start)).zero_()
        return shown
    if chance < config["unmasked"]:
        return torch.ones_like(shown)
    if chance < config["unmasked"] + config["wrong"]:
        shown = shown.clone()
        height, width = shown.shape[2:]
        for _ in range(int(rng.integers(2, 7))):
            v, size = int(rng.integers(shown.shape[1])), rng.integers(6, 48, 2)
            top, left = int(rng.integers(height)), int(rng.integers(width))
            patch = shown[:, v, top : top + int(size[0]), left : left + int(size[1])]
            patch.copy_(1 - patch if rng.random() < 0.5 else torch.ones_like(patch))
    return shown


def rendered(logits: Tensor, colour: Tensor, coverage: Tensor, distances: Tensor) -> Tensor:
    """The picture [3, H, W] of surface layers."""
    alpha, rgb = blend(logits, colour, coverage, distances.float(), VISIBLE_POWER)
    return composite(alpha, rgb, (coverage[-1] > 0).any(0), torch.zeros_like(alpha)).rgb


def errors(image: Tensor, truth: Tensor, counted: Tensor) -> tuple[Tensor, Tensor]:
    """Mean squared error, and L1 plus half the L1 of the gradients, over the pixels of a
    mask [H, W]."""
    difference = (image - truth) * counted
    gradients = (difference.diff(dim=axis).abs().mean() for axis in (-1, -2))
    return (difference**2).mean(), difference.abs().mean() + 0.5 * sum(gradients)


def plain_errors(frame: SurfaceFrame) -> tuple[float, float]:
    """Errors of the first layer with weights by distance alone."""
    shown = frame.shown[:1].float()
    colour, coverage = frame.colour[:1] / 255 * shown[:, :, None], frame.coverage[:1] / 255 * shown
    image = rendered(torch.zeros_like(coverage), colour, coverage, frame.distances)
    mean_square, gradients = errors(image, frame.target / 255, (coverage > 0).any(1).all(0))
    return float(mean_square), float(gradients)


def example_loss(
    net: UNet, crop: SurfaceFrame, plain: tuple[float, float], rng: np.random.Generator, config: dict
) -> tuple[Tensor, dict[str, float]]:
    """1 plus the errors beyond those of weights by distance on the same layers, relative to these
    and to the whole frame's (`plain`), so that every picture counts alike, as in a mean of PSNR;
    and on the true surface minus log of the weight on the views that see it."""
    layers = len(crop.colour) - (crop.seen is not None)
    true_surface = crop.seen is not None and (layers == 0 or rng.random() < config["true_surface"])
    if true_surface:
        own, shown = slice(-1, None), torch.ones(1)
    else:
        own = slice(layers) if rng.random() < config["all_layers"] else slice(at := int(rng.integers(layers)), at + 1)
        shown = masks(crop, rng, config)[own]
    colour, coverage = crop.colour[own].float() / 255, crop.coverage[own].float() / 255 * shown
    colour, truth = colour * (shown if true_surface else shown[:, :, None]), crop.target.float() / 255
    logits = net(colour.flatten(1, 2).contiguous(memory_format=torch.channels_last)).contiguous()
    image = rendered(logits, colour, coverage, crop.distances)
    counted = (coverage > 0).any(1).all(0)
    found = errors(image, truth, counted)
    with torch.no_grad():
        base = errors(rendered(torch.zeros_like(logits), colour, coverage, crop.distances), truth, counted)
    each = zip(found, base, plain, FLOOR, SHARES, strict=True)
    loss = 1 + sum(share * (a - b) / ((b * whole) ** 0.5 + floor) for a, b, whole, floor, share in each)
    figures = {"gain": 10 * math.log10((float(base[0]) + 1e-5) / (float(found[0].detach()) + 1e-5))}
    figures["loss"] = float(loss.detach())
    if true_surface:
        seen = crop.seen.masked_fill(coverage[0] < 0.5, UNKNOWN)
        where = partly_hidden(seen)
        share, plain = (
            weight_on_seen(view_weights(x, coverage, crop.distances, VISIBLE_POWER)[0], seen)
            for x in (logits, torch.zeros_like(logits))
        )
        count = where.sum().clamp(min=64)
        loss = loss + config["visible_weight"] * -(torch.log(share.clamp(min=1e-6)) * where).sum() / count
        if bool(where.any()):
            figures |= {"seen": float(share.detach()[where].mean()), "by distance": float(plain[where].mean())}
    else:  # without such pixels the weights by distance must stay unchanged
        varying = logits[:, 1:] - logits[:, 1:].mean((2, 3), keepdim=True)
        loss = loss + config["calm"] * (varying**2).mean()
    return loss, figures
