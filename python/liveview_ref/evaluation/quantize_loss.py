"""The loss by quantising a model: errors of its logits, and PSNR on held-out photos."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..data.held_out import INNER, Case, cases
from ..layer_spec import Guided, LayerSpec, Planes
from ..onnx_session import logits, session
from ..reference.competing import composite_competing
from ..reference.layers import warp_views
from ..reference.liveview import blend, view_distances
from ..reference.metrics import psnr
from .methods import composited, maps_of

LAYERS = Guided(4), Planes(16)
PLANES = Planes(16), Planes(32)  # for the models for planes


@dataclass
class Photo:
    """A held-out photo and its views, warped once for all models by warp_views; maps [L, H, W]."""

    layers: LayerSpec
    case: Case
    colour: Tensor
    coverage: Tensor
    maps: Tensor
    scale: float | None  # of competing layers

    def score(self, logits: Tensor) -> float:
        """PSNR of the picture from these logits."""
        target = self.case.target
        rgb = blend(logits, self.colour, self.coverage, view_distances(self.case.cameras, target))[1]
        crop = (..., slice(target.height), slice(target.width))
        layers = logits[:, 0][crop], rgb[crop], (self.coverage > 0).any(1)[crop]
        if self.scale is None:
            image = composited(layers, self.maps)[1]
        else:
            image = composite_competing(*layers, self.maps[crop], self.scale).rgb
        return psnr(image[INNER], self.case.truth[INNER])


class Loss(NamedTuple):
    """Logits of each photo; their root mean square error relative to the original's root mean
    square; PSNR or its change, by layers."""

    found: list[Tensor]
    logits: float
    psnr: dict[str, float]


def photos(specs: list[dict], data: Path, views: int, card: dict[str, str]) -> list[Photo]:
    """Held-out photos, with the layers and the composite of the model's card."""
    scale = float(card.get("alpha_scale", 1)) if card.get("alpha") == "competing" else None
    found = []
    for case in cases(specs, data, views):
        for layers in PLANES if card["trained_layers"].startswith("planes") else LAYERS:
            maps = maps_of(case, layers)
            warped = warp_views(case.sources, case.cameras, case.target, maps)
            found.append(Photo(layers, case, *warped, maps, scale))
    return found


def loss(model: Path, held_out: list[Photo], exact: Loss | None = None) -> Loss:
    """The loss of a model against `exact`; without it, PSNR itself."""
    network = session(model)
    found = [torch.from_numpy(logits(network, photo.colour.flatten(1, 2).numpy(), 1)) for photo in held_out]
    scores = [(photo.layers, photo.score(logits)) for photo, logits in zip(held_out, found, strict=True)]
    kinds = dict.fromkeys(photo.layers for photo in held_out)
    mean = {str(layers): float(np.mean([score for of, score in scores if of == layers])) for layers in kinds}
    if exact is None:
        return Loss(found, 0.0, mean)
    pairs = list(zip(found, exact.found, strict=True))
    wrong = np.mean([float(((a - b) ** 2).mean()) for a, b in pairs])
    share = float(np.sqrt(wrong / np.mean([float((b**2).mean()) for _, b in pairs])))
    return Loss(found, share, {layers: mean[layers] - exact.psnr[layers] for layers in mean})
