"""What cameras do to the views of a procedural scene: exposure, white balance, blur, noise,
compression. Views are [3, H, W] in [0, 1]."""

from io import BytesIO

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image
from torch import Tensor

from ..image import to_u8


def imperfections(rng: np.random.Generator, views: list[Tensor], exposures: tuple[float, float, float]) -> list[Tensor]:
    """Slight ones, alike in all views. exposures: probabilities of no, slight and strong
    differences of exposure."""
    exposure = rng.choice([0, 0.02, 0.15], p=exposures)
    noisy = rng.uniform(0.003, 0.015) if rng.random() < 0.3 else 0
    blurred, blocky = rng.random() < 0.1, rng.random() < 0.1
    out = []
    for view in views:
        gain = np.exp(rng.normal(0, exposure) + rng.normal(0, exposure / 2, (3, 1, 1)))
        view = view * torch.from_numpy(gain.astype(np.float32))
        if blurred:
            view = torch.lerp(
                view, F.avg_pool2d(view[None], 3, 1, 1, count_include_pad=False)[0], float(rng.uniform(0, 0.7))
            )
        if blocky:
            view = jpeg_like(view, float(rng.uniform(0.02, 0.1)))
        if noisy:
            view = view + noisy * torch.from_numpy(rng.standard_normal(view.shape, dtype=np.float32))
        out.append(view.clamp(0, 1).contiguous())
    return out


def phone(rng: np.random.Generator, views: list[Tensor], disparities: list[Tensor]) -> list[Tensor]:
    """A phone that is walked around with: it exposes and focuses each photo by itself, moves while
    it exposes, and writes JPEG."""
    quality, drift = int(rng.integers(45, 95)), float(rng.choice([0.0, 0.03, 0.08], p=[0.5, 0.4, 0.1]))
    open_wide, shaky = rng.random() < 0.3, rng.random() < 0.3
    out = []
    for view, disparity in zip(views, disparities, strict=True):
        gain = np.exp(rng.normal(0, drift) + rng.normal(0, drift / 3, (3, 1, 1)))
        view = view * torch.from_numpy(gain.astype(np.float32))
        if open_wide:
            focus = float(disparity.flatten()[rng.integers(disparity.numel())])
            view = defocused(view, (disparity - focus).abs() / disparity.max(), float(rng.uniform(1, 4)))
        if shaky and rng.random() < 0.5:
            view = moved(view, float(rng.uniform(1, 5)), float(rng.uniform(0, np.pi)))
        out.append(jpeg(view.clamp(0, 1), quality))
    return out


def moved(view: Tensor, length: float, angle: float) -> Tensor:
    """Motion blur: the mean along a line of `length` pixels."""
    _, height, width = view.shape
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    count = int(np.ceil(length)) + 1
    total = torch.zeros_like(view)
    for at in np.linspace(-length / 2, length / 2, count):
        grid = torch.stack(
            [(x + at * np.cos(angle)) * (2 / width) - 1, (y + at * np.sin(angle)) * (2 / height) - 1], -1
        )
        total += F.grid_sample(view[None], grid[None].float(), padding_mode="border", align_corners=False)[0]
    return total / count


def defocused(view: Tensor, away: Tensor, most: float) -> Tensor:
    """Defocus blur of up to `most` pixels: `away` [H, W] from the plane in focus, 0 to 1. Levels of
    blur are interpolated."""
    levels = [view]
    for _ in range(int(np.ceil(most))):
        padded = F.pad(levels[-1][None], (1, 1, 1, 1), mode="replicate")
        levels.append(F.avg_pool2d(padded, 3, 1)[0])
    at = (away * most).clamp(0, len(levels) - 1)
    weights = [(1 - (at - i).abs()).clamp(min=0) for i in range(len(levels))]
    return sum(weight * level for weight, level in zip(weights, levels, strict=True))


def jpeg(view: Tensor, quality: int) -> Tensor:
    """Written as JPEG and read back."""
    with BytesIO() as file:
        Image.fromarray(to_u8(view.permute(1, 2, 0).numpy())).save(file, "JPEG", quality=quality)
        pixels = np.array(Image.open(file))
    return torch.from_numpy(pixels).permute(2, 0, 1).float().div(255).contiguous()


def jpeg_like(view: Tensor, step: float) -> Tensor:
    """Round the coefficients of 8x8 cosine blocks, high frequencies more coarsely. [3, H, W]"""
    height, width = view.shape[1:]
    padded = F.pad(view[None], (0, -width % 8, 0, -height % 8), mode="replicate")[0]
    i = torch.arange(8)
    basis = torch.cos((2 * i + 1) * i[:, None] * (torch.pi / 16)) * torch.where(i == 0, 8**-0.5, 0.5)[:, None]
    blocks = padded.reshape(3, padded.shape[1] // 8, 8, padded.shape[2] // 8, 8).transpose(2, 3)
    steps = step * (0.5 + 0.25 * (i + i[:, None]))
    blocks = basis.T @ (torch.round(basis @ blocks @ basis.T / steps) * steps) @ basis
    return blocks.transpose(2, 3).reshape(padded.shape)[:, :height, :width]
