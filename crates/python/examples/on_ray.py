"""Renders a path of a scene on the workers of a Ray cluster, and makes a video of the frames if
ffmpeg is installed. Frames that a worker was rendering as it died are rendered again by another.

Every machine has the scene under the same name and an environment with liveview and ray[data]:
    python on_ray.py SCENE spiral:90 FOLDER --workers 8 --address auto
"""

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

import liveview
import ray


class Renderer:
    """A worker's synthesizer. It opens the whole path, whose depth range all frames share."""

    def __init__(self, scene: str, path: str, options: dict):
        opened = liveview.Scene(scene, width=options.pop("width"))
        self.frames = liveview.Synthesizer(opened, **options).render_path(opened.path(path))

    def __call__(self, row: dict) -> dict:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "frame.png")
            self.frames[int(row["id"])].save(file)
            return {"id": row["id"], "png": file.read_bytes()}


parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("scene", help="folder of a scene")
parser.add_argument("path", help="as `liveview render --path` takes it: SHAPE:N")
parser.add_argument("folder", type=Path, help="of the frames and the video")
parser.add_argument("--workers", type=int, default=2)
parser.add_argument("--threads", type=int, default=1, help="of each worker")
parser.add_argument("--address", default="local", help="the cluster; auto: the running one, local: this machine")
parser.add_argument("--layers", help="such as planes:64")
parser.add_argument("--network", help="model file")
parser.add_argument("--width", type=int, help="scale wider photos down to this width")
args = parser.parse_args()
scene = str(Path(args.scene).resolve())
count = len(liveview.Scene(scene, width=args.width).path(args.path))
args.folder.mkdir(parents=True, exist_ok=True)

ray.init(args.address, runtime_env={"env_vars": {"RAYON_NUM_THREADS": str(args.threads)}}, include_dashboard=False)
options = {"width": args.width, "layers": args.layers, "network": args.network}
frames = ray.data.range(count, override_num_blocks=count).map(
    Renderer, fn_constructor_args=[scene, args.path, options], concurrency=args.workers, num_cpus=args.threads
)
for done, frame in enumerate(frames.iter_rows(), 1):
    (args.folder / f"frame_{frame['id']:04}.png").write_bytes(frame["png"])
    print(f"frame {frame['id']}: {done} of {count}", flush=True)
if ffmpeg := shutil.which("ffmpeg"):
    pictures = ["-framerate", "30", "-i", args.folder / "frame_%04d.png", "-frames:v", str(count)]
    even = ["-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", "-pix_fmt", "yuv420p"]
    subprocess.run([ffmpeg, "-v", "error", "-y", *pictures, *even, args.folder / "video.mp4"], check=True)
