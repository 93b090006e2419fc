"""Validation during training: PSNR on held-out photos on guided layers and uniform planes, and a
picture to inspect."""

from pathlib import Path
from statistics import fmean

import torch
import torch.nn.functional as F
from torch import Tensor

from ..data.held_out import INNER, cases
from ..data.image import picture
from ..evaluation.methods import competing, composited, infer, maps_of, planes
from ..layer_spec import Guided, Planes
from ..reference.metrics import psnr
from .precision import reduced_precision

LAYERS = Guided(4), Guided(8), Planes(32)
SHOWN = Guided(4)  # next to the truth in the picture


def validate(net, specs: list[dict], data: Path, file: Path, device: torch.device) -> dict[str, float]:
    """Mean PSNR over the held-out photos for each of LAYERS; the file shows truth and SHOWN
    side by side."""
    scores = {str(layers): [] for layers in LAYERS}
    rows = []

    def network(hwv: Tensor) -> Tensor:
        with torch.no_grad():
            return net(hwv.to(device, memory_format=torch.channels_last)).cpu()

    for case in cases(specs, data, net.views):
        for layers in LAYERS:
            maps = maps_of(case, layers)
            image = composited(infer(network, case, maps), maps)[1]
            scores[str(layers)].append(psnr(image[INNER], case.truth[INNER]))
            if layers == SHOWN:
                rows.append(torch.cat([case.truth, image], 2))
    sheet_of(rows, file)
    return {layers: round(sum(s) / len(s), 3) for layers, s in scores.items()}


def sheet_of(rows: list[Tensor], file: Path) -> None:
    """Images [3, H, W] below each other, saved."""
    width = max(r.shape[2] for r in rows)
    sheet = torch.cat([F.pad(r, (0, width - r.shape[2])) for r in rows], 1)
    picture(sheet).save(file)


def validate_planes(net, specs: list[dict], data: Path, file: Path, config: dict) -> dict[str, float]:
    """Mean PSNR on 16 and 64 uniform planes, composited by the config's "alpha"; of 64 on each
    scene, and the mean over the scenes of each "set" that the specs name. The file shows truth
    and 64."""
    images = {"competing": competing, "independent": planes}[config["alpha"]]
    scores, scenes, sets, rows = {}, {}, {}, []

    def network(hwv: Tensor) -> Tensor:
        with reduced_precision():
            return net(hwv.contiguous(memory_format=torch.channels_last)).float().contiguous()

    with torch.inference_mode():
        for spec in specs:
            own = scenes.setdefault(spec["path"], [])
            for case in cases([spec], data, net.views):
                for name, image in images(network, case, counts=(16, 64)):
                    score = psnr(image[INNER], case.truth[INNER])
                    scores.setdefault(name, []).append(score)
                rows.append(torch.cat([case.truth, image], 2))
                own.append(score)
            if "set" in spec:
                sets.setdefault(f"mean of {spec['set']}", []).append(fmean(own))
    sheet_of(rows, file)
    return {name: round(fmean(s), 3) for name, s in (scores | sets | scenes).items()}
