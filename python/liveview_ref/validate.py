"""Validation during training: PSNR on held-out photos on guided layers and uniform planes, and a picture to look at."""

from pathlib import Path

import torch
import torch.nn.functional as F
from PIL import Image
from torch import Tensor

from .camera import choose_views
from .guide import guided_layers
from .layers import uniform_planes
from .metrics import psnr
from .render import planes_over, render
from .scene import open_scene

BORDER = 16
KINDS = {"guided 4": (True, 4), "guided 8": (True, 8), "planes 32": (False, 32)}


def resized(image: Tensor, width: int) -> Tensor:
    """[3, H, W] uint8 -> float in [0, 1] at this width, antialiased."""
    height = round(image.shape[1] * width / image.shape[2])
    image = F.interpolate(image[None].float() / 255, (height, width), mode="bilinear", antialias=True)
    return image[0].clamp(0, 1)


def cases(specs: list[dict], data: Path, views: int):
    """(sources, cameras, target camera, truth, near, far) for each held-out photo of the specs."""
    for spec in specs:
        scene = open_scene(data / spec["path"])
        heldout = set(range(0, len(scene.names), spec["heldout"])) if spec.get("heldout") else set(spec["targets"])
        pool = [i for i in spec.get("pool", range(len(scene.names))) if i not in heldout]
        for t in spec["targets"]:
            width = spec["width"] or scene.cameras[t].width
            truth = resized(scene.image_u8(t), width)
            target = scene.cameras[t].scaled_to(width, truth.shape[1])
            ids = [pool[i] for i in choose_views([scene.cameras[i] for i in pool], target, views)]
            sources = [resized(scene.image_u8(i), width) for i in ids]
            cameras = [scene.cameras[i].scaled_to(width, s.shape[1]) for i, s in zip(ids, sources, strict=True)]
            near = spec.get("near") or min(scene.bounds[i][0] for i in ids)
            far = spec.get("far") or max(scene.bounds[i][1] for i in ids)
            yield sources, cameras, target, truth, near, far


def validate(net, specs: list[dict], data: Path, picture: Path, device: torch.device) -> dict[str, float]:
    """Mean PSNR per kind of layers over the held-out photos; the picture shows truth and guided 4 side by side."""
    scores = {kind: [] for kind in KINDS}
    rows = []

    def network(hwv: Tensor) -> Tensor:
        with torch.no_grad():
            return net(hwv.to(device, memory_format=torch.channels_last)).cpu()

    for sources, cameras, target, truth, near, far in cases(specs, data, net.views):
        for kind, (guided, count) in KINDS.items():
            if guided:
                maps = guided_layers(sources, cameras, target, near, far, count)
            else:
                maps = planes_over(target, uniform_planes(near, far, count), torch.float32)
            image = render(network, sources, cameras, target, maps)[0].rgb
            inner = (..., slice(BORDER, -BORDER), slice(BORDER, -BORDER))
            scores[kind].append(psnr(image[inner], truth[inner]))
            if kind == "guided 4":
                rows.append(torch.cat([truth, image], 2))
    width = max(r.shape[2] for r in rows)
    sheet = torch.cat([F.pad(r, (0, width - r.shape[2])) for r in rows], 1)
    Image.fromarray((sheet.clamp(0, 1) * 255).round().byte().permute(1, 2, 0).numpy()).save(picture)
    return {kind: round(sum(s) / len(s), 3) for kind, s in scores.items()}
