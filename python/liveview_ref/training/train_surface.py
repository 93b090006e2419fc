"""Training on surface layers, for configs with a number of "frames" (data/surface_frames.py)."""

from pathlib import Path
from statistics import fmean

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..data.held_out import INNER
from ..data.surface_frames import SurfaceFrame
from ..reference.liveview import STRIDE, UNet
from ..reference.metrics import psnr, ssim
from ..reference.view_agreement import agreement_logits
from .surface_loss import crop_of, example_loss, interest, recoloured, rendered, without_a_view
from .validate import sheet_of

REFRESH_EVERY = 50  # steps after which new frames in the folder are used as well


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
                images = (rendered(x, colour, coverage, frame.distances) for x in (agreement_logits(colour), logits))
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
