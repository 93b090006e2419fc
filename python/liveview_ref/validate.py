"""Validation during training: PSNR on held-out photos on guided layers and uniform planes, and a picture to look at."""

from pathlib import Path

import torch
import torch.nn.functional as F
from PIL import Image
from torch import Tensor

from .heldout import INNER, cases
from .methods import competing, maps_of
from .metrics import psnr
from .render import render

KINDS = {"guided 4": (True, 4), "guided 8": (True, 8), "planes 32": (False, 32)}


def validate(net, specs: list[dict], data: Path, picture: Path, device: torch.device) -> dict[str, float]:
    """Mean PSNR per kind of layers over the held-out photos; the picture shows truth and guided 4 side by side."""
    scores = {kind: [] for kind in KINDS}
    rows = []

    def network(hwv: Tensor) -> Tensor:
        with torch.no_grad():
            return net(hwv.to(device, memory_format=torch.channels_last)).cpu()

    for case in cases(specs, data, net.views):
        for kind, layers in KINDS.items():
            image = render(network, *case[:3], maps_of(case, *layers))[0].rgb
            scores[kind].append(psnr(image[INNER], case.truth[INNER]))
            if kind == "guided 4":
                rows.append(torch.cat([case.truth, image], 2))
    sheet_of(rows, picture)
    return {kind: round(sum(s) / len(s), 3) for kind, s in scores.items()}


def sheet_of(rows: list[Tensor], picture: Path) -> None:
    """Images [3, H, W] below each other, saved."""
    width = max(r.shape[2] for r in rows)
    sheet = torch.cat([F.pad(r, (0, width - r.shape[2])) for r in rows], 1)
    Image.fromarray((sheet.clamp(0, 1) * 255).round().byte().permute(1, 2, 0).numpy()).save(picture)


def validate_competing(net, specs: list[dict], data: Path, picture: Path) -> dict[str, float]:
    """Mean PSNR on 16 and 64 uniform planes that compete, and of 64 on each scene; the picture shows truth and 64."""
    scores, scenes, rows = {}, {}, []

    def network(hwv: Tensor) -> Tensor:
        with torch.autocast("cpu", dtype=torch.bfloat16):
            return net(hwv.contiguous(memory_format=torch.channels_last)).float().contiguous()

    with torch.inference_mode():
        for spec in specs:
            for case in cases([spec], data, net.views):
                for name, image in competing(network, case, counts=(16, 64)):
                    score = psnr(image[INNER], case.truth[INNER])
                    scores.setdefault(name, []).append(score)
                rows.append(torch.cat([case.truth, image], 2))
                scenes.setdefault(spec["path"], []).append(score)
    sheet_of(rows, picture)
    return {name: round(sum(s) / len(s), 3) for name, s in (scores | scenes).items()}
