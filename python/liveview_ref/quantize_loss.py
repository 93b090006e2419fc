"""What another model of the same network costs: errors of logits, and PSNR on held-out photos."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import onnxruntime
import torch
from torch import Tensor

from .blend import blend
from .composite import composite
from .heldout import INNER, Case, cases
from .methods import maps_of
from .metrics import psnr
from .render import view_distances, warp_views

KINDS = {"guided 4": (True, 4), "planes 16": (False, 16)}


@dataclass
class Photo:
    """A held-out photo and its views, warped once for all models, as warp_views gives them; maps [L, H, W]."""

    kind: str
    case: Case
    colour: Tensor
    coverage: Tensor
    maps: Tensor

    def score(self, logits: Tensor) -> float:
        """PSNR of the picture that these logits make."""
        alpha, rgb = blend(logits, self.colour, self.coverage, view_distances(self.case.cameras, self.case.target))
        full = composite(alpha, rgb, (self.coverage[-1] > 0).any(0), self.maps).rgb
        image = full[..., : self.case.target.height, : self.case.target.width]
        return psnr(image[INNER], self.case.truth[INNER])


class Loss(NamedTuple):
    """Logits of each photo; their root mean square error, as a share of theirs; PSNR or its change, per kind."""

    found: list[Tensor]
    logits: float
    psnr: dict[str, float]


def photos(specs: list[dict], data: Path, views: int) -> list[Photo]:
    found = []
    for case in cases(specs, data, views):
        for kind, layers in KINDS.items():
            maps = maps_of(case, *layers)
            found.append(Photo(kind, case, *warp_views(case.sources, case.cameras, case.target, maps), maps))
    return found


def loss(model: Path, held_out: list[Photo], exact: Loss | None = None) -> Loss:
    """Of the model beside `exact`; without it, PSNR itself."""
    options = onnxruntime.SessionOptions()
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # other work shares the cores
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    found = []
    for photo in held_out:
        parts = [session.run(["logits"], {"hwv": layer.flatten(0, 1)[None].numpy()})[0] for layer in photo.colour]
        found.append(torch.from_numpy(np.concatenate(parts)))
    scores = [photo.score(logits) for photo, logits in zip(held_out, found, strict=True)]
    mean = {k: float(np.mean([s for p, s in zip(held_out, scores, strict=True) if p.kind == k])) for k in KINDS}
    if exact is None:
        return Loss(found, 0.0, mean)
    pairs = list(zip(found, exact.found, strict=True))
    wrong = np.mean([float(((a - b) ** 2).mean()) for a, b in pairs])
    share = float(np.sqrt(wrong / np.mean([float((b**2).mean()) for _, b in pairs])))
    return Loss(found, share, {kind: mean[kind] - exact.psnr[kind] for kind in mean})
