"""Training examples for surface layers: the inputs that the program gives its network, with the
errors of its depth.

Each example is a small scene, written to disk and rendered by the program
(`liveview dump --layers surface:L`): a held-out photo and some of the photos around it, or a
procedural scene with the depth of every view. Whole pictures are kept, as bytes; crops are
drawn during training.

    python -m liveview_ref.data.surface_frames CONFIG --data DATA --out FOLDER --program LIVEVIEW

With --held-out configs/evaluation.json, examples for validation from the held-out photos of a list
of scenes, in FOLDER/validation.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..config import read_config
from ..paths import ROOT
from ..reference.geometry.camera import Camera
from ..reference.geometry.view_selection import choose_views, looking_the_same_way, view_distances
from ..reference.render.renderer import warp_views
from .examples import RealScene
from .held_out import case_of, pool_of, targets_of
from .procedural.scene import random_scene
from .procedural.textures import Textures
from .scene import Scene, open_scene
from .shards import eight_bit, made, recipe_of
from .visibility import visibility
from .written_scene import write_photo, write_transforms


@dataclass
class SurfaceFrame:
    """colour [L, V, 3, H, W] and coverage [L, V, H, W] of the views on each layer, without
    occlusion; shown [L, V, H, W]: 1 where the program does not mask the view; target [3, H, W]; all
    uint8. distances [V] float64. seen [V, H, W] uint8: which views see the true surface
    (visibility.py), None on real scenes; if it is known, an additional last layer follows that
    surface; it may be the only one."""

    colour: Tensor
    coverage: Tensor
    shown: Tensor
    target: Tensor
    distances: Tensor
    seen: Tensor | None

    def save(self, path: Path) -> None:
        torch.save({f.name: getattr(self, f.name) for f in fields(self)}, path.with_suffix(".tmp"))
        path.with_suffix(".tmp").rename(path)

    @classmethod
    def load(cls, path: Path) -> "SurfaceFrame":
        """Memory-mapped: only the parts that are used are read."""
        return cls(**torch.load(path, weights_only=True, mmap=True))


@dataclass
class Rig:
    """Photos [3, H, W] in [0, 1] of a small scene, the target first; near and far in scene units.
    truth: disparities of all of them, on procedural scenes."""

    photos: list[Tensor]
    cameras: list[Camera]
    near: float
    far: float
    truth: list[Tensor] | None


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
    return Rig([images[i].float() / 255 for i in ids], [cameras[i] for i in ids], near, far, None)


def procedural_rig(rng: np.random.Generator, config: dict, textures: Textures) -> Rig:
    count = int(rng.integers(*config["photos"]))
    s = random_scene(rng, count, tuple(config["frame"]), textures, recipe_of(config))
    poses = zip([s.target_k, *s.view_k], [s.target_r, *s.view_r], [s.target_t, *s.view_t], strict=True)
    photos = [s.target, *s.views]
    cameras = [Camera(*pose, p.shape[2], p.shape[1]) for pose, p in zip(poses, photos, strict=True)]
    return Rig(photos, cameras, float(s.near), float(s.far), [s.disparity, *s.view_disparities])


def hiding_frame(rng: np.random.Generator, config: dict, textures: Textures) -> SurfaceFrame:
    """Only the true surface, of a procedural scene with much occlusion."""
    p = made(rng, config | {"crop": config["hiding_frame"]}, textures)
    colour, coverage = warp_views([v.float() / 255 for v in p.views], p.cameras, p.camera, p.disparity[None])
    shown = torch.ones(coverage.shape, dtype=torch.uint8)
    distances = view_distances(p.cameras, p.camera)
    return SurfaceFrame(eight_bit(colour), eight_bit(coverage), shown, p.target, distances, p.seen)


def held_out_rig(scene: Scene, spec: dict, t: int, views: int) -> Rig:
    """A held-out photo and all photos it may be rendered from, each at its own size."""
    near, far = case_of(scene, spec, t, views)[4:6]
    ids = [t, *pool_of(scene, spec)]
    return Rig([scene.image_u8(i).float() / 255 for i in ids], [scene.cameras[i] for i in ids], near, far, None)


def write_scene(rig: Rig, folder: Path) -> None:
    photos = enumerate(zip(rig.photos, rig.cameras, strict=True))
    write_transforms(folder, [write_photo(folder, f"{i:03}.png", photo, camera) for i, (photo, camera) in photos])


def dumped(rig: Rig, program: Path, views: int, layers: int, folder: Path) -> dict[str, Tensor]:
    write_scene(rig, folder)
    command = [program, "dump", folder, "--target", "000", "--views", str(views), "--layers", f"surface:{layers}"]
    command += ["--network", "model"]
    command += ["--near", str(rig.near), "--far", str(rig.far), "--threads", "1", "-o", folder / "dump.npz"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))}: {done.stderr.strip()}")
    with np.load(folder / "dump.npz") as arrays:
        return {name: torch.from_numpy(arrays[name]) for name in arrays.files if name != "logits"}


def frame_of(rig: Rig, found: dict[str, Tensor]) -> SurfaceFrame:
    """The input that the program gives its network, and its masks."""
    views = sum(name.endswith(".image") for name in found)
    target, height, width = rig.cameras[0], *rig.photos[0].shape[1:]
    images = [found[f"view{v}.image"].permute(2, 0, 1) for v in range(views)]
    sizes = [(image.shape[2], image.shape[1]) for image in images]
    poses = [tuple(found[f"view{v}.{part}"] for part in ("k", "rotation", "translation")) for v in range(views)]
    cameras = [Camera(*pose, *size) for pose, size in zip(poses, sizes, strict=True)]
    colour, coverage = warp_views(images, cameras, target, found["maps"])
    shown = found["coverage"] > 0
    own = found["colour"].reshape(colour.shape)
    colour = torch.where(shown[:, :, None], own, colour)
    coverage = torch.where(shown, found["coverage"], coverage)
    shown = shown | (coverage == 0)  # nothing to mask
    inner = (..., slice(height), slice(width))
    colour, coverage, shown, seen = colour[inner], coverage[inner], shown[inner], None
    if rig.truth is not None:
        centres = torch.stack([c.centre for c in rig.cameras])
        ids = [int((centres - c.centre).norm(dim=1).argmin()) for c in cameras]
        seen = visibility(rig.truth[0], target, [rig.truth[i] for i in ids], [rig.cameras[i] for i in ids])
        more = warp_views(images, cameras, target, rig.truth[0][None])
        colour, coverage = torch.cat([colour, more[0]]), torch.cat([coverage, more[1]])
        shown = torch.cat([shown, torch.ones_like(shown[:1])])
    bytes_ = eight_bit(colour), eight_bit(coverage), shown.to(torch.uint8).clone(), eight_bit(rig.photos[0])
    return SurfaceFrame(*bytes_, view_distances(cameras, target), seen)


def through(program: Path, rig: Rig, config: dict) -> SurfaceFrame:
    with tempfile.TemporaryDirectory() as folder:
        return frame_of(rig, dumped(rig, program, config["views"], config["layers"], Path(folder)))


def make(number: int, config: dict, scenes: list[RealScene], textures: Textures, program: Path) -> SurfaceFrame:
    """The frame of this number, determined by the seed and the number."""
    rng = np.random.default_rng([config["seed"], number])
    if rng.random() < config["hiding"]:
        return hiding_frame(rng, config, textures)
    if rng.random() < config["procedural"]:
        return through(program, procedural_rig(rng, config, textures), config)
    return through(program, real_rig(rng, config, scenes), config)


def make_held_out(config: dict, specs: Path, data: Path, folder: Path, program: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for spec in json.loads(specs.read_text()):
        scene = open_scene(next(root / spec["path"] for root in (data, ROOT) if (root / spec["path"]).is_dir()))
        for t in targets_of(scene, spec):
            name = spec.get("name", spec["path"]).replace(" ", "_")
            through(program, held_out_rig(scene, spec, t, config["views"]), config).save(folder / f"{name}_{t}.pt")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config", type=Path)
    parser.add_argument("--data", type=Path, required=True, help="folder with train/, dev/ and textures/")
    parser.add_argument("--out", type=Path, required=True, help="existing frames are kept")
    parser.add_argument("--program", type=Path, required=True, help="the program, liveview")
    parser.add_argument("--held-out", type=Path, metavar="SPEC", help="make examples for validation instead")
    args = parser.parse_args()
    torch.set_num_threads(1)
    config = read_config(args.config)
    if args.held_out:
        return make_held_out(config, args.held_out, args.data, args.out / "validation", args.program)
    scenes = [RealScene(args.data, spec, config["views"]) for spec in config["real"]]
    textures = Textures(args.data / config["textures"])
    args.out.mkdir(parents=True, exist_ok=True)
    for number in range(config["frames"]):
        path = args.out / f"{number:05}.pt"
        if path.exists():
            continue
        try:
            make(number, config, scenes, textures, args.program).save(path)
        except (RuntimeError, ValueError) as error:  # refused by the program, or no view looks that way
            print(f"skipped {number}: {error}", file=sys.stderr, flush=True)
        print(path.name, flush=True)


if __name__ == "__main__":
    main()
