"""Renderings of the evaluation by the program: surface layers, with the network and without one.
The reference would take seconds for the depth of each photo; parity tests compare the program's
stages with it.

The program renders a scene on disk with the photos that a case may be rendered from and the target,
at the case's size. The picture comes from `liveview dump`, so that it is not rounded to 8 bits.
"""

import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..data.held_out import Case, pool_of, resized
from ..data.scene import Scene
from ..data.written_scene import write_photo, write_transforms

TARGET = "target.png"
SURFACE = 2, 1
NO_NETWORK = ", no network"  # suffix of the name of layers
WITHOUT_NETWORK = 1, 3  # layers: for the comparison with the network, and the program's default without one


class Program(NamedTuple):
    """The program and its model (ONNX)."""

    binary: Path
    model: Path
    threads: int

    def missing(self) -> list[str]:
        """The files that are missing to run it."""
        return [f"{path.name} is missing" for path in (self.binary, self.model) if not path.is_file()]

    def surface(self, scene: Scene, spec: dict, target: int, case: Case):
        """Each number of surface layers, with the network and without. Yields (name, image
        [3, H, W])."""
        with tempfile.TemporaryDirectory() as folder:
            write_scene(Path(folder), scene, spec, target, case)
            for count in SURFACE:
                yield f"surface:{count}", self.render(Path(folder), spec, count, ["--model", self.model])
            without = ["--network", "none", "--views", len(case.views)]
            for count in WITHOUT_NETWORK:
                yield f"surface:{count}{NO_NETWORK}", self.render(Path(folder), spec, count, without)

    def render(self, folder: Path, spec: dict, layers: int, network: list) -> Tensor:
        """Render the target of the scene in this folder."""
        out = folder / "dump.npz"
        range_ = [x for end in ("near", "far") if spec.get(end) for x in (f"--{end}", spec[end])]
        options = ["--target", TARGET, "--layers", f"surface:{layers}", "--threads", self.threads, "-o", out]
        options += ["--cache", folder / "depth"]  # depth of the photos, the same for all layers
        command = [str(x) for x in (self.binary, "dump", folder, *options, *range_, *network)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{' '.join(command)}: {done.stderr.strip()}")
        with np.load(out) as arrays:
            frame = torch.from_numpy(arrays["frame"])
        out.unlink()  # the program does not overwrite files in a scene's folder
        return frame


def write_scene(folder: Path, scene: Scene, spec: dict, target: int, case: Case) -> None:
    """Write the photos that a case may be rendered from, and its target, with transforms.json."""
    frames = [write_photo(folder, TARGET, case.truth, case.target, scene.bounds[target])]
    for index in pool_of(scene, spec):
        photo = resized(scene.image_u8(index), case.target.width)
        camera = scene.cameras[index].with_size_scaled(photo.shape[2], photo.shape[1])
        frames.append(write_photo(folder, f"{index:04}.png", photo, camera, scene.bounds[index]))
    write_transforms(folder, frames)
