"""Training on surface layers, for configs with a number of "frames" (data/surface_frames.py)."""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..data.held_out import INNER
from ..data.surface_frames import SurfaceFrame
from ..evaluation.evaluate_visible import TARGETS, measure
from ..reference.image.metrics import psnr
from ..reference.unet import UNet
from .surface_loss import crop_of, example_loss, interest, plain_errors, recoloured, rendered
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
                    self.frames[path.name] = frame, interest(frame, self.config["crop"]), plain_errors(frame)
            if not self.frames:
                raise FileNotFoundError(f"{self.folder}: no frames; expected those of liveview_ref.data.surface_frames")
        return list(self.frames.values())

    def loss(self, net: UNet, example: tuple, rng: np.random.Generator) -> tuple[Tensor, dict[str, float]]:
        frame, chances, plain = example
        crop = crop_of(frame, chances, rng, self.config)
        if rng.random() < self.config["recoloured"]:
            crop = recoloured(crop, rng)
        return example_loss(net, crop, plain, rng, self.config)

    def summary(self, figures: list[dict[str, float]]) -> str:
        def mean(key: str) -> float:
            found = [t[key] for t in figures if key in t]
            return sum(found) / max(len(found), 1)

        text = f"{len(self.frames)} frames; loss {mean('loss'):.4f}; {mean('gain'):+.3f} dB against weights by distance"
        seen = f"seen weight {mean('seen'):.3f} (by distance {mean('by distance'):.3f})"
        return f"{text}; where views are hidden: {seen}"

    def validate(self, net: UNet, file: Path) -> dict[str, float]:
        scenes, rows = {}, []
        with torch.inference_mode():
            for path in sorted((self.folder / "validation").glob("*.pt")):
                frame = SurfaceFrame.load(path)
                layers = slice(None) if frame.seen is None else slice(-1)
                colour, coverage = (x[layers].float() / 255 for x in (frame.colour, frame.coverage))
                shown, truth = frame.shown[layers].float(), frame.target.float() / 255
                padding = [0, -truth.shape[2] % 8, 0, -truth.shape[1] % 8]
                colour, coverage = colour * shown[:, :, None], coverage * shown
                hwv = torch.nn.functional.pad(colour.flatten(1, 2), padding, "replicate")
                logits = net(hwv.contiguous(memory_format=torch.channels_last))
                logits = logits[..., : truth.shape[1], : truth.shape[2]].contiguous()
                image = rendered(logits, colour, coverage, frame.distances)
                scenes.setdefault(path.stem.rsplit("_", 1)[0], []).append(psnr(image[INNER], truth[INNER]))
                rows.append(torch.cat([truth, image], 2))
        sheet_of(rows, file)
        means = {name: round(sum(scores) / len(scores), 3) for name, scores in scenes.items()}
        each = [measure(lambda hwv: net(hwv), net.views, target) for target in TARGETS]
        seen = sum(e["network: weight"] for e in each) / len(each)
        return {"mean": round(sum(means.values()) / len(means), 3), **means, "weight on seen": round(seen, 3)}
