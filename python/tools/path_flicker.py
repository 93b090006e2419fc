"""Measure the flicker of a path over a still scene: 90 frames on a circle in front of the rig
clip's yard, against the truth.

Flicker is that of `liveview video`: mean |change of the picture - change of the truth| from frame
to frame, of 255, without a border of 16 pixels. The scene is the first frame of each camera, the
held-out one left out.

Usage, in python/:  python -m tools.path_flicker [--layers SPEC ...] [--frames N]
[-- OPTIONS OF liveview render]
"""

import argparse
import json
import os
import shutil
import subprocess
import tempfile
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image

from liveview_ref.data.opengl import flip_axes

from .make_rig_clip import OUT, SCENE, shapes_at
from .raycaster import Texture, picture

ROOT = Path(__file__).resolve().parents[2]
SIZE = 504, 352
FOCAL = 480.0  # pixels
RADIUS = 0.035  # scene units, about the radius of the rig
BORDER = 16


def circle(frames: int) -> list[np.ndarray]:
    """World from camera [3, 4] of each frame, OpenCV axes: on a circle among the cameras,
    in their direction."""
    angles = 2 * np.pi * np.arange(frames) / frames
    return [SCENE["place"](RADIUS * np.cos(a), RADIUS * np.sin(a), 0, 0, 0, -7)[:3] for a in angles]


@cache
def textures() -> dict:
    return {name: Texture(image) for name, image in SCENE["textures"]().items()}


def truth(pose: np.ndarray) -> np.ndarray:
    """The picture of a camera at the clip's first frame, 8 bit."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return picture(shapes_at(0, 18), textures(), (FOCAL, pose), *SIZE)


def render(args, folder: Path, poses: list[np.ndarray], layers: str) -> list[np.ndarray]:
    """The frames rendered on these layers."""
    camera = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": SIZE[0] / 2, "cy": SIZE[1] / 2, "w": SIZE[0], "h": SIZE[1]}
    cameras = [camera | {"transform_matrix": flip_axes(np.vstack([pose, [0, 0, 0, 1]])).tolist()} for pose in poses]
    (folder / "path.json").write_text(json.dumps(cameras))
    out = folder / layers.replace(":", "_")
    command = [args.liveview, "render", folder / "scene", "--pose", folder / "path.json", "--layers", layers]
    subprocess.run([*command, "-o", out, *args.options], check=True, stdout=subprocess.PIPE, cwd=ROOT)
    return [np.asarray(Image.open(file).convert("RGB")) for file in sorted(out.glob("*.png"))]


def inner(frames: list[np.ndarray]) -> np.ndarray:
    return np.stack(frames).astype(np.float32)[:, BORDER:-BORDER, BORDER:-BORDER]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--layers", nargs="+", default=["guided:2", "surface:1", "surface:2"])
    parser.add_argument("--frames", type=int, default=90)
    parser.add_argument("--liveview", default=str(ROOT / "target/release/liveview"))
    parser.add_argument("options", nargs="*", help="options of liveview render, after --")
    args = parser.parse_args()
    poses = circle(args.frames)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        true = inner(list(pool.map(truth, poses)))
    print("| layers | PSNR dB | flicker, of 255 |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder, "scene")
        for photo in sorted(OUT.glob("cam*/0000.jpg")):
            (scene / photo.parent.name).mkdir(parents=True)
            shutil.copy(photo, scene / photo.parent.name)
        cameras = json.loads((OUT / "transforms.json").read_text())
        cameras["frames"] = [frame for frame in cameras["frames"] if frame["file_path"].startswith("cam")]
        (scene / "transforms.json").write_text(json.dumps(cameras))
        for layers in args.layers:
            frames = inner(render(args, Path(folder), poses, layers))
            psnr = np.mean([10 * np.log10(255**2 / np.square(a - b).mean()) for a, b in zip(frames, true, strict=True)])
            flicker = np.abs(np.diff(frames, axis=0) - np.diff(true, axis=0)).mean()
            print(f"| {layers} | {psnr:.2f} | {flicker:.3f} |", flush=True)


if __name__ == "__main__":
    main()
