"""Training on surface layers, for configs with a number of "frames" (data/surface_frames.py). The
loss of a crop: the errors of its picture relative to those of the views' agreement alone, so that
every picture counts alike, as in a mean of PSNR and SSIM."""

import math
from dataclasses import replace
from pathlib import Path
from statistics import fmean

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..data.held_out import INNER
from ..data.surface_frames import SurfaceFrame
from ..reference.competing import composite_competing
from ..reference.liveview import STRIDE, UNet, blend
from ..reference.metrics import psnr, ssim
from ..reference.surface.correction import CORRECTED_POWER
from ..reference.view_agreement import agreement_logits
from .precision import reduced_precision
from .validate import sheet_of

REFRESH_EVERY = 50  # steps after which new frames in the folder are used as well
CELL = 16  # pixels
FLOOR = 1e-4, 0.03  # squared error (40 dB), 1 - SSIM
LEAST_COVERED = 0.5  # share of a crop


def rendered(logits: Tensor, colour: Tensor, coverage: Tensor, distances: Tensor) -> Tensor:
    """The picture [3, H, W] of competing surface layers."""
    alpha, rgb = blend(logits, colour, coverage, distances.float(), CORRECTED_POWER)
    return composite_competing(logits[:, 0], rgb, (coverage > 0).any(1), torch.zeros_like(alpha)).rgb


def interest(frame: SurfaceFrame, crop: list[int]) -> np.ndarray:
    """Probabilities of crops by their position in cells of CELL pixels: by the error of the views'
    agreement, plus a constant."""
    colour, coverage, target = (x.float() / 255 for x in (frame.colour, frame.coverage, frame.target))
    image = rendered(agreement_logits(colour, coverage), colour, coverage, frame.distances)
    score = F.avg_pool2d((image - target).abs().mean(0)[None, None], tuple(crop), CELL)[0, 0].clamp(max=0.25)
    score = (score + 0.2 * score.mean() + 1e-4).double()
    return (score / score.sum()).numpy()


def crop_of(frame: SurfaceFrame, chances: np.ndarray, rng: np.random.Generator, config: dict) -> SurfaceFrame:
    """A crop, randomly flipped or transposed."""
    top, left = (CELL * int(i) for i in divmod(int(rng.choice(chances.size, p=chances.ravel())), chances.shape[1]))
    top += int(rng.integers(min(CELL, frame.target.shape[1] - top - config["crop"][0] + 1)))
    left += int(rng.integers(min(CELL, frame.target.shape[2] - left - config["crop"][1] + 1)))
    window = (..., slice(top, top + config["crop"][0]), slice(left, left + config["crop"][1]))
    axes = [axis for axis in (-1, -2) if rng.random() < 0.5]
    turn = rng.random() < 0.5

    def cut(x: Tensor) -> Tensor:
        x = x[window].flip(axes)
        return x.transpose(-1, -2) if turn else x

    return SurfaceFrame(*(cut(x) for x in (frame.colour, frame.coverage, frame.target)), frame.distances)


def recoloured(crop: SurfaceFrame, rng: np.random.Generator) -> SurfaceFrame:
    """The crop with other colours, the same in all views and the truth, because the few real scenes
    must not be recognised by their colours. Black stays black."""
    order = torch.from_numpy(rng.permutation(3))
    gain = torch.from_numpy(np.exp(rng.normal(0, 0.2, 3))).float()[:, None, None]

    def other(x: Tensor) -> Tensor:
        return (x[..., order, :, :] * gain).round().clamp(0, 255).to(torch.uint8)

    return replace(crop, colour=other(crop.colour), target=other(crop.target))


def without_a_view(crop: SurfaceFrame, rng: np.random.Generator) -> SurfaceFrame:
    """The crop with one view masked, as where its photo ends."""
    kept = torch.ones(crop.coverage.shape[1], dtype=torch.uint8)
    kept[int(rng.integers(len(kept)))] = 0
    return replace(crop, colour=crop.colour * kept[:, None, None, None], coverage=crop.coverage * kept[:, None, None])


def errors(image: Tensor, truth: Tensor) -> tuple[Tensor, Tensor]:
    """Mean squared error, and 1 - SSIM over windows of 7x7."""

    def mean(x: Tensor) -> Tensor:
        return F.avg_pool2d(x[None], 7, 1)[0]

    a, b = mean(image), mean(truth)
    variances, covariance = mean(image**2) - a**2 + mean(truth**2) - b**2, mean(image * truth) - a * b
    ssim = (2 * a * b + 1e-4) * (2 * covariance + 9e-4) / ((a**2 + b**2 + 1e-4) * (variances + 9e-4))
    return ((image - truth) ** 2).mean(), 1 - ssim.mean()


def example_loss(net: UNet, crop: SurfaceFrame) -> tuple[Tensor, dict[str, float]]:
    """1.5 times the logarithm of the ratio of squared errors plus the relative change of 1 - SSIM;
    0 for the views' agreement alone. Uncovered pixels count as right."""
    colour, coverage, truth = (x.float() / 255 for x in (crop.colour, crop.coverage, crop.target))
    covered = (coverage > 0).any(1).any(0)
    if covered.float().mean() < LEAST_COVERED:
        return sum(p.sum() for p in net.parameters()) * 0.0, {}
    with reduced_precision():
        logits = net(colour.flatten(1, 2).contiguous(memory_format=torch.channels_last)).float().contiguous()

    def found(logits: Tensor) -> tuple[Tensor, Tensor]:
        image = rendered(logits, colour, coverage, crop.distances)
        return errors(torch.where(covered, image, truth), truth)

    square, structure = found(logits)
    with torch.no_grad():
        base_square, base_structure = found(agreement_logits(colour, coverage))
    ratio = (square + FLOOR[0]) / (base_square + FLOOR[0])
    loss = 1.5 * torch.log(ratio) + (structure - base_structure) / (base_structure + FLOOR[1])
    return loss, {"gain": -10 * math.log10(float(ratio.detach())), "ssim": float(base_structure - structure.detach())}


class Surface:
    """A fine_tune.Task. Frames are in a folder, those for validation in its subfolder
    `validation`."""

    def __init__(self, config: dict, frames: Path):
        self.config, self.folder, self.frames = config, frames, {}

    def examples(self, step: int) -> list[tuple]:
        if not self.frames or step % REFRESH_EVERY == 0:
            for path in sorted(self.folder.glob("*.pt")):
                if path.name not in self.frames:
                    frame = SurfaceFrame.load(path)
                    with torch.inference_mode():
                        self.frames[path.name] = frame, interest(frame, self.config["crop"])
            if not self.frames:
                raise FileNotFoundError(f"{self.folder}: no frames; expected those of liveview_ref.data.surface_frames")
        return list(self.frames.values())

    def loss(self, net: UNet, example: tuple, rng: np.random.Generator) -> tuple[Tensor, dict[str, float]]:
        crop = crop_of(*example, rng, self.config)
        if rng.random() < self.config["recoloured"]:
            crop = recoloured(crop, rng)
        if rng.random() < self.config["without_a_view"]:
            crop = without_a_view(crop, rng)
        return example_loss(net, crop)

    def summary(self, figures: list[dict[str, float]]) -> str:
        gain, structure = (fmean([t[key] for t in figures if t] or [0.0]) for key in ("gain", "ssim"))
        return f"{len(self.frames)} frames; against the views' agreement {gain:+.3f} dB, SSIM {structure:+.4f}"

    def validate(self, net: UNet, file: Path) -> dict[str, float]:
        """PSNR and SSIM by agreement and by the network: the mean over the scenes of each set, and
        the gain on each scene, dB."""
        scenes, rows = {}, []
        with torch.inference_mode():
            for path in sorted((self.folder / "validation").glob("*.pt")):
                frame = SurfaceFrame.load(path)
                colour, coverage, truth = (x.float() / 255 for x in (frame.colour, frame.coverage, frame.target))
                padding = [0, -truth.shape[2] % STRIDE, 0, -truth.shape[1] % STRIDE]
                hwv = F.pad(colour.flatten(1, 2), padding, "replicate").contiguous(memory_format=torch.channels_last)
                logits = net(hwv)[..., : truth.shape[1], : truth.shape[2]].contiguous()
                uncovered = (coverage == 0).all(1).all(0)
                both = agreement_logits(colour, coverage), logits
                images = (rendered(x, colour, coverage, frame.distances) for x in both)
                base, image = (torch.where(uncovered, truth, x) for x in images)
                scores = [metric(x[INNER], truth[INNER]) for x in (base, image) for metric in (psnr, ssim)]
                scenes.setdefault(path.stem.rsplit("_", 1)[0], []).append(scores)
                rows.append(torch.cat([truth, base, image], 2))
        sheet_of(rows, file)
        means = {name: [fmean(column) for column in zip(*scores, strict=True)] for name, scores in scenes.items()}
        found = {}
        for kind in dict.fromkeys(name.split("-")[0] for name in means):
            own = zip(*(scores for name, scores in means.items() if name.startswith(kind)), strict=True)
            names = ("agreement dB", "agreement SSIM", "network dB", "network SSIM")
            found |= {f"{kind}: {name}": round(fmean(column), 4) for name, column in zip(names, own, strict=True)}
        return found | {f"gain: {name}": round(scores[2] - scores[0], 3) for name, scores in means.items()}
