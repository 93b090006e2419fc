"""Training on uniform planes, competing or independent, for configs with "shards".

A shard of examples is made when first needed.
"""

from pathlib import Path

import numpy as np
from torch import Tensor

from ..data.shards import Photos, Shards
from ..reference.liveview import UNet
from .planes_loss import example_loss
from .validate import validate_planes


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
