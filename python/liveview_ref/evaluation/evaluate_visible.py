"""The weight that a model gives to the views that truly see the surface, at pixels where another
view is occluded.

    python -m liveview_ref.evaluation.evaluate_visible MODEL.pt|MODEL.onnx ...

On the example scene at its true depth, with one layer along the truth. Compared with the network:
weights by the views' agreement (which the program uses without a network) and by distance alone.
Reported are the weight and the PSNR of the layer's colour, on all pixels and on these. "weight" is
the share of views known to see the surface among all that cover the pixel; "of known" leaves out
views whose visibility is unknown (mostly at edges). First without masks: what the network can infer
by itself. Then "masked": without the views that are occluded by the depth that the program
(`make build`) computes for their photos.
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from ..data.held_out import INNER
from ..data.scene import Scene, open_scene
from ..data.visibility import SEEN, UNKNOWN, partly_hidden, visibility
from ..paths import BINARY, ROOT
from ..reference.layers import warp_views
from ..reference.liveview import Network, blend, padded_size, view_distances
from ..reference.metrics import psnr
from ..reference.surface.correction import CORRECTED_POWER
from ..reference.surface.fusion import visible
from ..reference.surface.photo_depth import pixel_of
from ..reference.surface.render import hide
from ..reference.surface.target_surface import OCCLUSION_MARGIN
from ..reference.view_agreement import agreement_logits
from ..reference.views import choose_views, widest_parallax
from .evaluate import load_model
from .view_weights import view_weights, weight_on_seen

SCENE = ROOT / "tests/scenes/workshop"
TARGETS = 7, 8


def true_disparity(scene: Scene, index: int) -> Tensor:
    """The true disparity of a photo, [H, W] float32, 1/scene unit."""
    largest = json.loads((scene.root / "depth/scale.json").read_text())["delta_max"]
    with Image.open(scene.root / "depth" / f"{Path(scene.names[index]).stem}.png") as image:
        return torch.from_numpy(np.array(image).astype(np.float32)) * (largest / 65535)


def edge_padded(x: Tensor, size: tuple[int, int]) -> Tensor:
    return torch.nn.functional.pad(x[None, None], (0, size[1] - x.shape[1], 0, size[0] - x.shape[0]), "replicate")[0, 0]


def found_depths(program: Path) -> dict[str, Tensor]:
    """The disparities [H, W] of each photo, by name, that the program finds and other photos
    confirm, else -1."""
    names = open_scene(SCENE).names
    held_out = ",".join(Path(names[target]).name for target in TARGETS)
    with tempfile.TemporaryDirectory() as folder:
        command = [program, "depth", SCENE, "--target", held_out, "-o", folder]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        photos = [name for index, name in enumerate(names) if index not in TARGETS]
        return {name: torch.from_numpy(np.load(Path(folder) / f"{Path(name).stem}.npy")) for name in photos}


@torch.inference_mode()
def measure(network: Network, views: int, target: int, depths: dict[str, Tensor] | None = None) -> dict[str, float]:
    """The figures of one target; with the photos' `depths`, "masked" as well."""
    scene = open_scene(SCENE)
    camera, pool = scene.cameras[target], [i for i in range(len(scene.names)) if i not in TARGETS]
    ids = [pool[i] for i in choose_views([scene.cameras[i] for i in pool], camera, views)]
    photos, cameras = [scene.image_u8(i).float() / 255 for i in ids], [scene.cameras[i] for i in ids]
    truth, disparity = scene.image_u8(target).float() / 255, true_disparity(scene, target)
    layer = edge_padded(disparity, padded_size(*disparity.shape))
    colour, coverage = warp_views(photos, cameras, camera, layer[None])
    distances = view_distances(cameras, camera).float()
    seen = visibility(disparity, camera, [true_disparity(scene, i) for i in ids], cameras)
    height, width = disparity.shape
    seen = seen.masked_fill(coverage[0, :, :height, :width] < 0.5, UNKNOWN)
    where, found = partly_hidden(seen), {}
    found["partly hidden"] = float(where.float().mean())
    kinds = [("", colour, coverage, 1.0)]
    if depths is not None:
        near, far = float(1 / disparity.max()), float(1 / disparity[disparity > 0].min())
        size = padded_size(camera.height, camera.width)
        margin = OCCLUSION_MARGIN * pixel_of(widest_parallax(cameras, camera, near, far, size), near, far)
        known = [(c, depths[scene.names[i]]) for c, i in zip(cameras, ids, strict=True)]
        masks = torch.stack([visible(c, depth, camera, layer, margin) for c, depth in known])
        left = hide(masks, colour[0], coverage[0])
        kinds.append((", masked", left[0][None], left[1][None], CORRECTED_POWER))
    for kind, colour, coverage, power in kinds:
        by_network, by_distance = network(colour.flatten(1, 2)), torch.zeros_like(coverage)
        ways = {"network": by_network, "agreement": agreement_logits(colour), "distance": by_distance}
        for name, logits in ways.items():
            weights = view_weights(logits, coverage, distances, power)[0, :, :height, :width]
            image = blend(logits, colour, coverage, distances, power)[1][0, :, :height, :width]
            error = ((image - truth) ** 2).mean(0)
            found[f"{name}{kind}: weight"] = float((weights * (seen == SEEN)).sum(0)[where].mean())
            found[f"{name}{kind}: of known"] = float(weight_on_seen(weights, seen)[where].mean())
            found[f"{name}{kind}: dB"] = psnr(image[INNER], truth[INNER])
            found[f"{name}{kind}: dB there"] = float(-10 * torch.log10(error[where].mean()))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", type=Path, nargs="+")
    parser.add_argument("--binary", type=Path, default=BINARY)
    args = parser.parse_args()
    depths = found_depths(args.binary.absolute())
    for model in args.models:
        network, views, _ = load_model(model)
        each = [measure(network, views, target, depths) for target in TARGETS]
        mean = {key: sum(e[key] for e in each) / len(each) for key in each[0]}
        print(f"{model}: " + ", ".join(f"{key} {value:.3f}" for key, value in mean.items()), flush=True)


if __name__ == "__main__":
    main()
