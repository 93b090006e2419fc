"""One render of a scene by the package, with every stage in the order of the pipeline; the table,
and the first stage that departs."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..checkpoint import load_network
from ..extension import liveview
from ..layer_spec import Guided, Planes, parse
from ..paths import MODELS, ROOT
from ..reference.guided import search_planes
from ..reference.liveview import Camera, UNet, uniform_disparities
from ..reference.surface.depth_range import found_range
from ..reference.surface.photo_depth import PhotoDisparity
from ..reference.surface.render import neighbours_of
from ..reference.undistort import Distortion, undistort
from ..reference.views import with_helpers
from ..rig_arrays import Arrays
from . import stages, surface
from .compared import HEAD, TOLERANCES, Compared, exact, joined, row


class Rendered(NamedTuple):
    """A scene of the package, the target, the depth range that was given, the arrays of every stage
    (crates/python/src/stages/picture.rs), and what the options chose."""

    scene: object
    target: Camera
    given: tuple[float | None, float | None]
    data: Arrays
    about: dict

    @classmethod
    def of(cls, scene, target: str | Camera, **options) -> "Rendered":
        """`options`: of the package's `render_scene`, as those of the program."""
        models = Path(os.environ.get("LIVEVIEW_MODELS") or MODELS)
        options |= {"models": models, "runtime": runtime(options.get("engine"))}
        data, about = liveview._stages.render_scene(scene, target, options)
        data = {name: np.asarray(value) for name, value in data.items()}
        camera = target if isinstance(target, Camera) else camera_of(scene.cameras[scene.names.index(about["target"])])
        return cls(scene, camera, (options.get("near"), options.get("far")), data, about)

    def views(self, which: list[int]) -> list[surface.View]:
        """Photos [3, h, w] of these views, and their cameras."""
        return [(image_of(self.scene.photo(view)), camera_of(self.scene.cameras[view])) for view in which]

    @property
    def photos(self) -> list[int]:
        """The views to render from, then the helpers."""
        return self.data["shot.photos"].tolist()

    @property
    def free(self) -> list[int]:
        """The views that are not held out."""
        return self.data["shot.free"].tolist()

    def neighbours(self, view: int) -> list[int]:
        """The views whose photos that of `view` is matched with."""
        cameras = [camera_of(self.scene.cameras[other]) for other in self.free]
        return [self.free[i] for i in neighbours_of(cameras, self.free.index(view))]


def runtime(engine: str | None) -> Path | None:
    """The folder of the ONNX Runtime that has an engine, if it is not the installed one."""
    name = {"openvino": ".venv-openvino", "cpu": None, None: None}.get(engine, ".venv-cuda")
    return name and next(ROOT.glob(f"{name}/lib/python*/site-packages/onnxruntime/capi"), None)


def image_of(photo: np.ndarray) -> Tensor:
    return torch.from_numpy(photo).permute(2, 0, 1).contiguous()


def camera_of(camera) -> Camera:
    parts = (torch.from_numpy(part) for part in (camera.k, camera.rotation, camera.translation))
    return Camera(*parts, camera.width, camera.height)


def choice(rendered: Rendered) -> Compared:
    cameras = [camera_of(rendered.scene.cameras[view]) for view in rendered.free]
    count = rendered.data["coverage"].shape[1]
    chosen = with_helpers(cameras, rendered.target, count, len(rendered.photos) - count)
    return exact("views", rendered.data["shot.photos"], [rendered.free[i] for i in chosen])


def known_range(rendered: Rendered, views: list[int]) -> tuple[float, float] | None:
    """Near and far as given, or the extremes of those of the views; None if one is unknown."""
    known = [found for view in views if (found := rendered.scene.depth_ranges[view])]
    near, far = rendered.given
    near = min((near for near, _ in known), default=None) if near is None else near
    far = max((far for _, far in known), default=None) if far is None else far
    return None if near is None or far is None else (near, far)


def depth_range(rendered: Rendered, searched: bool) -> Iterator[Compared]:
    """Of the shot, and of the photos' depth. Where none is known it is found from the photos
    (`searched`)."""
    shot = rendered.photos[: rendered.data["coverage"].shape[1]]
    for name, found, among in (
        ("depth_range", "shot.range", shot),
        ("searched_range", "surface.range", rendered.free),
    ):
        if found not in rendered.data:
            continue
        known = known_range(rendered, among)
        if known is not None and not searched:
            yield exact(name, rendered.data[found], known)
        elif known is None and searched:
            ends, views = 1 / rendered.data[found], rendered.views(rendered.free)
            yield row(name, ends, lambda views: [1 / end for end in found_range(views)], views, entry="found_range")


def undistorted(rendered: Rendered) -> Iterator[Compared]:
    """The photos without the distortion of their lens, from the originals."""
    for i, view in enumerate(rendered.photos):
        of = {name.split(".")[1]: value for name, value in rendered.data.items() if name.startswith(f"original{i}.")}
        if not of:
            continue
        k, p = tuple(float(of[f"k{n}"]) for n in range(1, 7)), (float(of["p1"]), float(of["p2"]))
        [(image, camera)] = rendered.views([view])
        model = Distortion(bool(of["fisheye"]), k, p)
        yield row("undistorted", image, undistort, image_of(of["photo"]), camera.k, model)


def planes(rendered: Rendered, rig: stages.Rig) -> Iterator[Compared]:
    """Planes evenly spaced, or those of the first guided search. Where the photos' depth is used,
    planes lie between the depths that it gives, those of the first and the last plane; a Rust test
    checks these."""
    data, spec = rendered.data, parse(rendered.about["layers"])
    near, far = data["shot.range"].tolist()
    if isinstance(spec, Planes):
        if "gains" in data:
            near, far = max(near, 1 / data["disparities"][0]), min(far, 1 / data["disparities"][-1])
        yield exact("planes", data["disparities"], uniform_disparities(near, far, spec.count), "homography")
    elif isinstance(spec, Guided):
        found = search_planes(rig.cameras, rig.target, near, far, spec.coarse_planes)
        yield exact("planes", data["coarse_disparities"], found, "homography")


def searches(rendered: Rendered, photos: int | None) -> Iterator[Compared]:
    """The search of the depth of the shot's photos, or of the first ones."""
    span, neighbours = tuple(rendered.data["surface.range"].tolist()), liveview._stages.neighbours
    cameras = [rendered.scene.cameras[view] for view in rendered.free]
    for i, view in enumerate(rendered.photos[:photos]):
        members = [view, *rendered.neighbours(view)]
        for member in members:
            found = neighbours(cameras, rendered.free.index(member))
            yield exact("neighbours", [rendered.free[other] for other in found], rendered.neighbours(member))
        groups = [rendered.views([member, *rendered.neighbours(member)]) for member in members]
        depth = PhotoDisparity(rendered.data[f"depth{i}"], float(rendered.data["pixel"][i]))
        if len(members) > 1:
            yield from surface.photo_search(groups, span, depth)


def rows(
    rendered: Rendered, reduced: Rendered | None, net: UNet | None, photos: int | None = None
) -> Iterator[Compared]:
    """Every output of every stage, the first stage first. `reduced`: surface layers of smaller
    photos, for the search of their depth; `photos`: only of the first ones."""
    data, about = rendered.data, rendered.about
    count = data["coverage"].shape[1]
    views = rendered.views(rendered.photos)
    rig = stages.Rig(*map(list, zip(*views[:count], strict=True)), rendered.target)
    if net is not None:
        yield from weights(source_model(about), net)
    yield choice(rendered)
    yield from depth_range(rendered, searched=False)
    if reduced:
        yield from depth_range(reduced, searched=True)
    yield from joined(undistorted(rendered))
    yield from planes(rendered, rig)
    yield stages.homography(rig, data.get("disparities", 1 / data["shot.range"]))
    if reduced:
        yield from joined(searches(reduced, photos))
    if "surface" in data:
        yield from joined(surface.at_target(views, rendered.target, tuple(data["surface.range"].tolist()), data))
    else:
        yield from stages.guided_search(data, rig) if "costs" in data else ()
        yield from stages.warp(data, rig)
    yield stages.logits(data, net, logits_entry(about))
    yield from stages.picture(data, rig)


def logits_entry(about: dict) -> str:
    """The entry of the tolerance file: logits in another precision, or by another engine than cpu,
    have their own."""
    if about["model"] is None or (about["precision"], about["engine"]) == ("f32", "cpu"):
        return "logits"
    return f"logits {about['precision'] if about['precision'] != 'f32' else about['engine']}"


def source_model(about: dict) -> Path:
    """The float32 model of the model that Rust ran: an int8 model is in the same folder
    as its original."""
    path = Path(about["model"])
    return path.with_name(path.name.replace("_int8", "")) if about["precision"] == "int8" else path


def weights(model: Path, net: UNet) -> Iterator[Compared]:
    """The exported weights against those of the checkpoint beside the model, if there is one."""
    checkpoint = model.with_suffix(".pt")
    if checkpoint.exists():
        trained, found = load_network(checkpoint).state_dict(), net.state_dict()
        if {k: v.shape for k, v in found.items()} != {k: v.shape for k, v in trained.items()}:
            yield exact("weights", [len(found)], [np.inf], "weights")
            return
        flat = (torch.cat([state[name].flatten() for name in found]).numpy() for state in (found, trained))
        mine, original = flat
        yield Compared.of("weights", (mine, original, original))


def report(name: Path, rendered: Rendered, reduced: Rendered | None, both_ways: bool) -> str | None:
    """Prints the table; returns the first stage that departs. `both_ways`: a stage whose decisions
    are all the same departs, too."""
    data, about = rendered.data, rendered.about
    if logits_entry(about) not in TOLERANCES:
        raise ValueError(f"parity/tolerances.json: no bound for {logits_entry(about)}")
    net = load_network(source_model(about)) if about["model"] else None
    print(f"{name}, target {about['target']}, {about['layers']}, views {', '.join(about['views'])}")
    if reduced:
        width = max(camera.width for camera in reduced.scene.cameras)
        print(f"the search of the photos' depth: at a width of {width} pixels")
    print(f"\n{HEAD}")
    first = None
    for one in rows(rendered, reduced, net):
        print(one.row(), flush=True)
        first = first or (one.name if one.departs or both_ways and one.is_one_sided else None)
    chosen = np.array_equal(stages.best_layer(data), data["best_layer"])
    print(f"\nthe same layer chosen at each pixel: {'yes' if chosen else 'NO'}")
    first = first or (None if chosen else "best_layer")
    return first or (None if net is None or onnxruntime_agrees(data, about) else "onnxruntime")


def onnxruntime_agrees(data: Arrays, about: dict) -> bool:
    """Whether onnxruntime gives the same bits; only engine cpu is compared."""
    if about["engine"] != "cpu":
        print(f"engine {about['engine']}: only the logits of engine cpu are compared bit by bit with onnxruntime's")
        return True
    import onnxruntime  # here: a process in which Rust runs another engine must not load it

    from .. import onnx_session

    network = onnx_session.session(Path(about["model"]), about["threads"])
    python = onnx_session.logits(network, data["colour"], 1)
    same = np.array_equal(python, data["logits"])
    off = float(np.abs(python - data["logits"]).max())
    library = next((Path(onnxruntime.__file__).parent / "capi").glob("libonnxruntime.so.*"), None)
    if library is None or not library.samefile(about["library"]):
        print(f"note: Rust ran {about['library']}, Python {library}")
    print(f"ort = onnxruntime, bit for bit: {'yes' if same else f'NO, up to {off:.1e}'}")
    return same
