"""Renderings of the evaluation by the Python package (`make wheel`): surface layers, with the
network and without one. The reference would take seconds for the depth of each photo; parity tests
compare the library's stages with it.

A scene on disk has the photos that a case may be rendered from and the target, at the case's size.
"""

import importlib
import tempfile
from pathlib import Path
from typing import NamedTuple

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
    """The package and a model (ONNX)."""

    model: Path

    def missing(self) -> list[str]:
        """What is missing to run it."""
        try:
            importlib.import_module("liveview_ref.extension")
        except ImportError as error:
            return [str(error)]
        return [] if self.model.is_file() else [f"{self.model.name} is missing"]

    def surface(self, scene: Scene, spec: dict, target: int, case: Case):
        """Each number of surface layers, with the network and without. Yields (name, image
        [3, H, W])."""
        with tempfile.TemporaryDirectory() as folder:
            write_scene(Path(folder), scene, spec, target, case)
            for count in SURFACE:
                yield f"surface:{count}", render(Path(folder), spec, count, network=self.model)
            for count in WITHOUT_NETWORK:
                yield f"surface:{count}{NO_NETWORK}", render(Path(folder), spec, count, views=len(case.views))


def render(folder: Path, spec: dict, layers: int, **options) -> Tensor:
    """Render the target of the scene in this folder; options of the package's synthesizer."""
    from ..extension import liveview  # here: it needs the wheel

    options |= {end: spec[end] for end in ("near", "far") if spec.get(end)}
    # The depth of the photos is the same for all layers.
    options |= {"layers": f"surface:{layers}", "cache": folder / "depth"}
    picture = liveview.Synthesizer(liveview.Scene(folder), **options).render(TARGET).picture
    return torch.from_numpy(picture).permute(2, 0, 1)


def write_scene(folder: Path, scene: Scene, spec: dict, target: int, case: Case) -> None:
    """Write the photos that a case may be rendered from, and its target, with transforms.json."""
    frames = [write_photo(folder, TARGET, case.truth, case.target, scene.bounds[target])]
    for index in pool_of(scene, spec):
        photo = resized(scene.image_u8(index), case.target.width)
        camera = scene.cameras[index].with_size_scaled(photo.shape[2], photo.shape[1])
        frames.append(write_photo(folder, f"{index:04}.png", photo, camera, scene.bounds[index]))
    write_transforms(folder, frames)
