"""Write the table of models/README.md of what limits quality: `make report STEP=limits`.

On the example scene's two targets, where the depth of target and views is known: the program's
pictures, and one layer along the true depth; with view weights by the network and by agreement,
side by side; with all views, with true per-view occlusion, and with the pixels that are occluded in
all views taken from the truth.
"""

import json
import subprocess
import tempfile
from pathlib import Path

import torch
from torch import Tensor

from liveview_ref.checkpoint import load_network
from liveview_ref.data.held_out import INNER
from liveview_ref.data.scene import open_scene
from liveview_ref.data.visibility import HIDDEN, UNKNOWN, visibility
from liveview_ref.evaluation.evaluate_visible import SCENE, TARGETS, edge_padded, true_disparity
from liveview_ref.reference.layers import warp_views
from liveview_ref.reference.liveview import blend, padded_size, view_distances
from liveview_ref.reference.metrics import psnr
from liveview_ref.reference.surface.correction import CORRECTED_POWER
from liveview_ref.reference.view_agreement import agreement_logits
from liveview_ref.reference.views import choose_views

from .marked_text import fill

ROOT = Path(__file__).resolve().parents[2]
MODELS, PROGRAM = ROOT / "models", ROOT / "target/release/liveview"
VIEWS = 4
EDGE = 0.1  # weight of a view whose four pixels around the point show different surfaces
NETWORKS = "network", "no network"


def rendered(layers: str, network: str, names: list[str]) -> list[float]:
    """PSNR of the program's pictures."""
    chosen = ["--network", "none"] if network == "no network" else ["--model", MODELS / f"liveview_v{VIEWS}.onnx"]
    with tempfile.TemporaryDirectory() as folder:
        options = ["--target", ",".join(names), "--views", VIEWS, "--layers", layers, "-o", folder, "--json", *chosen]
        command = [str(part) for part in (PROGRAM, "render", SCENE, *options)]
        report = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return [target["psnr"] for target in report["targets"]]


@torch.inference_mode()
def along_the_truth(net, target: int) -> dict[tuple[str, str], float]:
    """PSNR of one layer along the true depth, by (what is known, weights)."""
    scene = open_scene(SCENE)
    camera, pool = scene.cameras[target], [i for i in range(len(scene.names)) if i not in TARGETS]
    ids = [pool[i] for i in choose_views([scene.cameras[i] for i in pool], camera, VIEWS)]
    photos, cameras = [scene.image_u8(i).float() / 255 for i in ids], [scene.cameras[i] for i in ids]
    truth, disparity = scene.image_u8(target).float() / 255, true_disparity(scene, target)
    height, width = disparity.shape
    layer = edge_padded(disparity, padded_size(height, width))
    colour, coverage = warp_views(photos, cameras, camera, layer[None])
    distances = view_distances(cameras, camera)
    known = visibility(disparity, camera, [true_disparity(scene, i) for i in ids], cameras)
    sees, unmixed = torch.ones_like(coverage), torch.ones_like(coverage)
    sees[0, :, :height, :width] = (known != HIDDEN).float()
    unmixed[0, :, :height, :width] = torch.where(known == UNKNOWN, EDGE, 1.0)
    occluded = (coverage * sees).sum(1, keepdim=True) <= 0
    sees = torch.where(occluded, 1.0, sees)  # as the renderer: occlusion of all views is ignored
    found = {}

    def score(what: str, mask: Tensor, power: float, fill_occluded: bool) -> None:
        shown, counts = colour * mask[:, :, None], coverage * mask
        undimmed = colour * (mask > 0)[:, :, None]  # the agreement compares colours before they are weighted
        for name in NETWORKS:
            logits = net(shown.flatten(1, 2)) if name == "network" else agreement_logits(undimmed)
            image = blend(logits, shown, counts, distances, power)[1][0, :, :height, :width]
            if fill_occluded:
                image = torch.where(occluded[0, :, :height, :width], truth, image)
            found[what, name] = psnr(image[INNER], truth[INNER])

    score("all views", torch.ones_like(sees), 1.0, False)
    score("occlusion", sees, CORRECTED_POWER, False)
    score("edges", sees * unmixed, CORRECTED_POWER, False)
    score("filled", sees * unmixed, CORRECTED_POWER, True)
    return found


def table() -> str:
    names = [Path(open_scene(SCENE).names[target]).stem for target in TARGETS]
    columns = [f"{name}, {network}" for name in names for network in NETWORKS]
    lines = ["| PSNR, dB | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]

    def row(what: str, scores: list[tuple[float, float]]) -> None:
        cells = [f"{score:.2f}" for pair in scores for score in pair]
        lines.append(f"| {what} | " + " | ".join(cells) + " |")

    for layers in ("guided:2", "surface:1"):
        pairs = [rendered(layers, network, names) for network in NETWORKS]
        row(f"the program, {layers}", list(zip(*pairs, strict=True)))
    net = load_network(MODELS / f"liveview_v{VIEWS}.pt")
    found = [along_the_truth(net, target) for target in TARGETS]
    for key, what in {
        "all views": "one layer along the true depth, all views count",
        "occlusion": "the same with true per-view occlusion",
        "edges": "and a tenth of the weight for views whose four pixels show different surfaces",
        "filled": "and pixels occluded in all views taken from the truth",
    }.items():
        row(what, [tuple(each[key, network] for network in NETWORKS) for each in found])
    return "\n".join(lines)


def main() -> None:
    fill(MODELS / "README.md", {"limits": f"\n\n{table()}\n\n"})


if __name__ == "__main__":
    main()
