"""Pictures by the Rust library, through its Python package (`make wheel`): surface layers, with the
network and without one. The reference would take seconds for the depth of each photo; parity tests
compare the library's stages with it."""

import tempfile
from pathlib import Path

import torch
from torch import Tensor

from ..data.held_out import Case, pool_of, resized
from ..data.image import to_u8
from ..data.scene import Scene
from ..reference.liveview import Camera

SURFACE = 2, 1
NO_NETWORK = ", no network"  # suffix of the name of layers
WITHOUT_NETWORK = 1, 3  # layers: for the comparison with the network, and the program's default without one


def missing(model: Path) -> list[str]:
    """What is missing to render with a model (ONNX)."""
    found = [] if model.is_file() else [f"{model.name} is missing"]
    try:
        from ..extension import liveview  # noqa: F401
    except ImportError as error:
        found.append(str(error))
    return found


def rendered(photos: list[Tensor], cameras: list[Camera], target: Camera, **options) -> Tensor:
    """The picture [3, h, w] of a target, black where no photo covers it, from photos [3, h, w] in
    [0, 1], as 8 bits; options as `liveview.Synthesizer` takes them. ImportError without the
    package."""
    from ..extension import in_memory, liveview  # here, because few need it

    scene = in_memory([to_u8(photo.permute(1, 2, 0).numpy()) for photo in photos], cameras)
    return torch.from_numpy(liveview.Synthesizer(scene, **options).render(target).raw).permute(2, 0, 1)


def surface(model: Path, scene: Scene, spec: dict, case: Case):
    """Each number of surface layers, with the network and without, from all photos that the case
    may be rendered from. Yields (name, image [3, H, W])."""
    pool = pool_of(scene, spec)
    photos = [resized(scene.image_u8(i), case.target.width) for i in pool]
    cameras = [scene.cameras[i].with_size_scaled(p.shape[2], p.shape[1]) for i, p in zip(pool, photos, strict=True)]
    near = float(spec.get("near") or min(scene.bounds[i][0] for i in pool))
    far = float(spec.get("far") or max(scene.bounds[i][1] for i in pool))
    kinds = [(count, model, "") for count in SURFACE] + [(count, None, NO_NETWORK) for count in WITHOUT_NETWORK]
    with tempfile.TemporaryDirectory() as cache:  # the depth of the photos is the same for all
        for count, network, suffix in kinds:
            options = {"views": len(case.views), "near": near, "far": far, "network": network, "cache": cache}
            image = rendered(photos, cameras, case.target, layers=f"surface:{count}", **options)
            yield f"surface:{count}{suffix}", image
