"""Training examples for surface layers: what the library renders a held-out photo from.

Each example is a small scene, whose layers along the surface are warped by the Python package
(`make wheel`): a photo of a real scene and some of those around it, or a procedural scene. Whole
pictures are kept, as bytes; crops are drawn during training.

    python -m liveview_ref.data.surface_frames CONFIG --data DATA --out FOLDER

The photos under "validation" in the config become examples in FOLDER/validation.
"""

import argparse
import sys
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..config import read_config
from ..paths import ROOT
from ..reference.liveview import Camera, view_distances
from ..reference.views import choose_views, looking_the_same_way
from .examples import RealScene
from .held_out import case_of, pool_of, targets_of
from .image import to_u8
from .procedural.scene import random_scene
from .procedural.textures import Textures
from .scene import Scene, open_scene
from .shards import eight_bit, recipe_of


@dataclass
class SurfaceFrame:
    """colour [L, V, 3, H, W] (black where the view is masked) and coverage [L, V, H, W] of
    the views on each layer; target [3, H, W]; all uint8. distances [V] float64."""

    colour: Tensor
    coverage: Tensor
    target: Tensor
    distances: Tensor

    def save(self, path: Path) -> None:
        torch.save({f.name: getattr(self, f.name) for f in fields(self)}, path.with_suffix(".tmp"))
        path.with_suffix(".tmp").rename(path)

    @classmethod
    def load(cls, path: Path) -> "SurfaceFrame":
        """Memory-mapped: only the parts that are used are read."""
        return cls(**torch.load(path, weights_only=True, mmap=True))


@dataclass
class Rig:
    """Photos [3, H, W] in [0, 1] of a small scene, the target first; near and far in scene
    units."""

    photos: list[Tensor]
    cameras: list[Camera]
    near: float
    far: float


def real_rig(rng: np.random.Generator, config: dict, scenes: list[RealScene]) -> Rig:
    """A photo of a real scene and some of those around it; the nearest may be left out."""
    weights = np.array([scene.weight for scene in scenes])
    scene = scenes[rng.choice(len(scenes), p=weights / weights.sum())]
    images, cameras = scene.sizes[rng.integers(len(scene.sizes))]
    t = int(rng.choice(scene.targets))
    others = [i for i in range(len(cameras)) if i != t]
    least = config["views"] + 1
    looking = len(looking_the_same_way([cameras[i] for i in others], cameras[t]))
    pool = min(looking, int(rng.integers(least, least + scene.reach + 1)))
    near_by = choose_views([cameras[i] for i in others], cameras[t], pool)
    pick = rng.permutation(pool)[: int(rng.integers(*config["photos"]))]
    ids = [t, *(others[near_by[p]] for p in pick)]
    near = scene.near or min(scene.bounds[i][0] for i in ids)
    far = scene.far or max(scene.bounds[i][1] for i in ids)
    return Rig([images[i].float() / 255 for i in ids], [cameras[i] for i in ids], near, far)


def procedural_rig(rng: np.random.Generator, config: dict, textures: Textures) -> Rig:
    count = int(rng.integers(*config["photos"]))
    s = random_scene(rng, count, tuple(config["frame"]), textures, recipe_of(config))
    return Rig([s.target, *s.views], [s.target_camera, *s.cameras], float(s.near), float(s.far))


def held_out_rig(scene: Scene, spec: dict, t: int, photos: int) -> Rig:
    """A held-out photo and the nearest photos that it may be rendered from, at most `photos`, at
    the spec's width."""
    facing = looking_the_same_way([scene.cameras[i] for i in pool_of(scene, spec)], scene.cameras[t])
    case = case_of(scene, spec, t, min(photos, len(facing)))
    return Rig([case.truth, *case.sources], [case.target, *case.cameras], case.near, case.far)


def frame_of(rig: Rig, config: dict) -> tuple[SurfaceFrame, dict[str, np.ndarray]]:
    """What the package warps to the target, over the photo's own size; and every stage of the
    target, without a network."""
    from ..extension import in_memory, liveview  # here: it needs the wheel

    scene = in_memory([to_u8(photo.permute(1, 2, 0).numpy()) for photo in rig.photos], rig.cameras)
    options = {"views": config["views"], "layers": f"surface:{config['layers']}", "network": False}
    found, _ = liveview._stages.render_scene(scene, 0, options | {"near": rig.near, "far": rig.far})
    height, width = rig.photos[0].shape[1:]
    colour, coverage = (torch.from_numpy(found[name]) for name in ("colour", "coverage"))
    colour = colour.unflatten(1, (-1, 3))
    views = found["shot.photos"][: coverage.shape[1]]
    distances = view_distances([rig.cameras[view] for view in views], rig.cameras[0])
    maps = (eight_bit(x[..., :height, :width]) for x in (colour, coverage, rig.photos[0]))
    return SurfaceFrame(*maps, distances), found


def make(number: int, config: dict, scenes: list[RealScene], textures: Textures) -> SurfaceFrame:
    """The frame of this number, determined by the seed and the number."""
    rng = np.random.default_rng([config["seed"], number])
    if rng.random() < config["procedural"]:
        return frame_of(procedural_rig(rng, config, textures), config)[0]
    return frame_of(real_rig(rng, config, scenes), config)[0]


def make_held_out(config: dict, data: Path, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for spec in config["validation"]:
        scene = open_scene(next(root / spec["path"] for root in (data, ROOT) if (root / spec["path"]).is_dir()))
        for t in targets_of(scene, spec):
            path = folder / f"{spec['set']}-{Path(spec['path']).name}_{t}.pt"
            if not path.exists():
                frame_of(held_out_rig(scene, spec, t, max(config["photos"])), config)[0].save(path)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config", type=Path)
    parser.add_argument("--data", type=Path, required=True, help="folder with train/, dev/ and textures/")
    parser.add_argument("--out", type=Path, required=True, help="existing frames are kept")
    args = parser.parse_args(arguments)
    torch.set_num_threads(1)
    config = read_config(args.config)
    make_held_out(config, args.data, args.out / "validation")
    scenes = [RealScene(args.data, spec, config["views"]) for spec in config["real"]]
    textures = Textures(args.data / config["textures"])
    args.out.mkdir(parents=True, exist_ok=True)
    for number in range(config["frames"]):
        path = args.out / f"{number:05}.pt"
        if path.exists():
            continue
        try:
            make(number, config, scenes, textures).save(path)
        except (RuntimeError, ValueError) as error:  # refused by the library, or too few views look that way
            print(f"skipped {number}: {error}", file=sys.stderr, flush=True)
        print(path.name, flush=True)


if __name__ == "__main__":
    main()
