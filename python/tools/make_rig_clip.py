"""Make tests/scenes/rig, the example clip: the moving sets of its scene.py from five cameras and
a held-out one.

Usage, in python/ (needs numpy, pillow):
    python -m tools.make_rig_clip [--frames N] [--size WxH] [--out DIR]  draw the clip
    python -m tools.make_rig_clip --check [--out DIR]                    reproject the photos
"""

import argparse
import json
import os
import runpy
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from PIL import Image

from liveview_ref.data.scene import flip_axes

from .raycaster import Texture, cast, picture, rays

OUT = Path(__file__).resolve().parents[2] / "tests" / "scenes" / "rig"
SCENE = runpy.run_path(str(OUT / "scene.py"))
RATE = 30  # frames per second
SPOTS = [(-0.033, -0.03), (0.033, -0.03), (-0.066, 0.03), (0, 0.03), (0.066, 0.03)]  # x, y of the sources


def rig(width, height):
    """name -> (focal in pixels, world from camera [3, 4], OpenCV axes): two above three, as if
    mounted by hand; a target inside."""
    rng = np.random.default_rng(5)
    spots = {f"cam{k:02}": spot for k, spot in enumerate(SPOTS)} | {"target": (0.018, 0.004)}
    cameras = {}
    for name, (x, y) in spots.items():
        shift, (yaw, roll, pitch) = rng.uniform(-0.007, 0.007, 3), rng.uniform(-1, 1, 3) * (1.0, 0.8, 0.8)
        turned = SCENE["place"](x, y, 0, yaw, roll, pitch - 7)  # looks down by 7 degrees
        turned[:3, 3] += shift
        cameras[name] = 480 * width / 504 * (1 + 0.012 * rng.uniform(-1, 1)), turned[:3]
    return cameras


def shapes_at(frame, frames):
    """The shapes of a frame: the cut is at 60 % of the clip, the cart appears at 30 %."""
    return SCENE["SETS"][frame >= round(0.6 * frames)](frame / RATE, (frame - round(0.3 * frames)) / RATE)


def draw(job):
    """Draw one photo to its file."""
    frame, name, args = job
    if not hasattr(draw, "textures"):  # once per process
        draw.textures = {name: Texture(image) for name, image in SCENE["textures"]().items()}
    shapes, camera = shapes_at(frame, args.frames), rig(*args.size)[name]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth, _ = cast(shapes, camera, *rays(camera, *args.size, 1))
        if not SCENE["NEAR"] < depth.min() <= depth.max() < SCENE["FAR"]:
            raise ValueError(
                f"frame {frame}, {name}: depths {depth.min()} to {depth.max()}; expected the scene's range"
            )
        image = picture(shapes, draw.textures, camera, *args.size)
    path = args.out / name / f"{frame:04}.jpg"
    path.parent.mkdir(parents=True, exist_ok=True)
    quality = max(args.quality, 85) if name == "target" else args.quality
    Image.fromarray(image).save(path, quality=quality, subsampling="4:4:4", optimize=True)


def write_cameras(out, width, height):
    """transforms.json, with OpenGL camera axes."""
    head = {"camera_model": "PINHOLE", "w": width, "h": height, "cx": width / 2, "cy": height / 2}
    frames = []
    for name, (focal, pose) in rig(width, height).items():
        matrix = flip_axes(np.vstack([pose, [0, 0, 0, 1]]))
        file = {"file_path": f"{name}/0000.jpg", "fl_x": round(focal, 6), "fl_y": round(focal, 6)}
        frames.append(file | {"transform_matrix": matrix.round(9).tolist()})
    head |= {"near": SCENE["NEAR"], "far": SCENE["FAR"], "frames": frames}
    (out / "transforms.json").write_text(json.dumps(head, indent=1) + "\n")


def check(out):
    """Compare the photos on disk with the target, reprojected by their poses on disk and the
    scene's depth.

    Median absolute difference of 8-bit colours over the pixels that both see, for three frames; at
    most 6.
    """
    file = json.loads((out / "transforms.json").read_text())
    frames, size = len(list((out / "target").glob("*.jpg"))), (file["w"], file["h"])
    cameras = {
        view["file_path"].split("/")[0]: (view["fl_x"], flip_axes(np.array(view["transform_matrix"]))[:3])
        for view in file["frames"]
    }
    for frame in (0, round(0.6 * frames) - 1, frames - 1):
        photos = {k: np.asarray(Image.open(out / k / f"{frame:04}.jpg")).astype(float) for k in cameras}
        with np.errstate(divide="ignore", invalid="ignore"):
            shapes = shapes_at(frame, frames)
            depths = {k: cast(shapes, camera, *rays(camera, *size, 1))[0] for k, camera in cameras.items()}
        x, y = rays(cameras["target"], *size, 1)
        pose = cameras["target"][1]
        d = pose[:, 0] * x[..., None] + pose[:, 1] * y[..., None] + pose[:, 2]
        p = pose[:, 3] + depths["target"][..., None] * d
        for name, (focal, pose) in cameras.items():
            q = (p - pose[:, 3]) @ pose[:, :3]
            column, row = (np.floor(focal * q[..., k] / q[..., 2] + n / 2).astype(int) for k, n in enumerate(size))
            on = (column >= 0) & (column < size[0]) & (row >= 0) & (row < size[1])
            on[on] = np.abs(depths[name][row[on], column[on]] / q[on][:, 2] - 1) < 0.01
            error = np.median(np.abs(photos[name][row[on], column[on]] - photos["target"][on]))
            print(f"frame {frame}, {name}: {error:.1f} of 255 over {on.mean():.0%} of the target")
            if error > 6:
                raise SystemExit(f"{out / name}: photo, pose and scene do not match")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=18)
    parser.add_argument("--size", type=size, default=(504, 352), metavar="WxH")
    parser.add_argument("--quality", type=int, default=68, help="of the JPEG files; the truth's is 85 or more")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--check", action="store_true", help="only reproject the photos on disk")
    args = parser.parse_args()
    if args.check:
        return check(args.out)
    cameras = rig(*args.size)
    for name in cameras:  # of a longer clip
        for path in (args.out / name).glob("[0-9][0-9][0-9][0-9].jpg"):
            path.unlink()
    jobs = [(frame, name, args) for frame in range(args.frames) for name in cameras]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for done, _ in enumerate(pool.map(draw, jobs), 1):
            if sys.stderr.isatty():
                print(f"\r{done} of {len(jobs)} photos", end="" if done < len(jobs) else "\n", file=sys.stderr)
    write_cameras(args.out, *args.size)


def size(text):
    width, height = map(int, text.split("x"))
    return width, height


if __name__ == "__main__":
    main()
