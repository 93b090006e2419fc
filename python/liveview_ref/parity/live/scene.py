"""The choice of views, the depth range and the planes of a shot, and its photos without lens
distortion, computed from the cameras and originals of the dump.

`scene.k`, `scene.rotation` [N, 3, 3], `scene.translation` [N, 3], `scene.size` [N, 2]: all views;
`scene.free` [N]: 0 for those held out; `scene.range` [N, 2], `scene.given` [2]: near and far, NaN
where there is none. `shot.photos`: the views to render from, then the helpers; `shot.range` [2].
`original{i}.photo` [h, w, 3]: of view i, with its lens: `original{i}.k1` to `k6`, `p1`, `p2`,
`fisheye`. `photo{v}.colours` [h, w, 3]: of view v of the scene.
"""

from collections.abc import Iterator

import numpy as np
import torch

from ...layer_spec import Guided, Planes, parse
from ...reference.guided import search_planes
from ...reference.liveview import Camera, uniform_disparities
from ...reference.surface.depth_range import found_range
from ...reference.surface.photo_depth import NEIGHBOURS
from ...reference.undistort import Distortion, undistort
from ...reference.views import choose_views, nearest_first
from ...rig_arrays import Arrays, cameras_of
from .compared import Compared

BOTH = torch.float64, torch.float32


def scene_cameras(data: Arrays) -> list[Camera]:
    """Those of all views."""
    parts = [torch.from_numpy(data[f"scene.{name}"]) for name in ("k", "rotation", "translation")]
    return [Camera(*pose, int(w), int(h)) for *pose, (w, h) in zip(*parts, data["scene.size"], strict=True)]


def free_views(data: Arrays) -> list[int]:
    return [int(view) for view in np.flatnonzero(data["scene.free"])]


def neighbours_of(data: Arrays, view: int) -> list[int]:
    """The views whose photos that of `view` is matched with."""
    cameras, others = scene_cameras(data), [other for other in free_views(data) if other != view]
    return [others[i] for i in nearest_first([cameras[other] for other in others], cameras[view])[:NEIGHBOURS]]


def exact(name: str, found: np.ndarray, expected, entry: str = "choice") -> Compared:
    """Something that is computed in float64 in both languages."""
    expected = np.asarray(expected)
    return Compared.of(name, (found, expected, expected), entry, scaled=True)


def choice(data: Arrays) -> Iterator[Compared]:
    cameras, free, (_, target) = scene_cameras(data), free_views(data), cameras_of(data)
    chosen = choose_views([cameras[v] for v in free], target, len(data["shot.photos"]))
    yield exact("views", data["shot.photos"], [free[i] for i in chosen])


def known_range(data: Arrays, views: list[int]) -> tuple[float, float] | None:
    """Near and far as given, or the extremes of those of the views; None if one is unknown."""
    with np.errstate(invalid="ignore"):
        near, far = data["scene.given"]
        ranges = data["scene.range"][views]
        known = ranges[~np.isnan(ranges[:, 0])]
        near = known[:, 0].min(initial=np.inf) if np.isnan(near) else near
        far = known[:, 1].max(initial=-np.inf) if np.isnan(far) else far
    return None if near == np.inf or far == -np.inf else (float(near), float(far))


def depth_range(data: Arrays, searched: bool) -> Iterator[Compared]:
    """Of the shot, and of the photos' depth. Where none is known it is found from the photos, if
    this is a dump with all of them (`searched`)."""
    views = [int(v) for v in data["shot.photos"]][: len(cameras_of(data)[0])]
    for name, among in ("shot.range", views), ("surface.range", free_views(data)):
        if name not in data:
            continue
        row = "depth_range" if name == "shot.range" else "searched_range"
        known = known_range(data, among)
        if known is not None and not searched:
            yield exact(row, data[name], known)
        elif known is None and searched:
            photos = {v: torch.from_numpy(data[f"photo{v}.colours"]).permute(2, 0, 1) for v in free_views(data)}
            cameras = scene_cameras(data)
            both = [found_range([(photos[v].to(dtype), cameras[v]) for v in photos]) for dtype in BOTH]
            ends = [np.array([1 / near, 1 / far]) for near, far in both]
            yield Compared.of(row, (1 / data[name], *ends), "found_range", scaled=True)


def planes(data: Arrays, layers: str) -> Iterator[Compared]:
    """Planes evenly spaced, or those of the first guided search. Where the photos' depth is used,
    planes lie between the depths that it gives, those of the first and the last plane; a Rust test
    checks these."""
    (near, far), spec = data["shot.range"], parse(layers)
    if isinstance(spec, Planes):
        if "gains" in data:
            near, far = max(near, 1 / data["disparities"][0]), min(far, 1 / data["disparities"][-1])
        yield exact("planes", data["disparities"], uniform_disparities(near, far, spec.count), "homography")
    elif isinstance(spec, Guided):
        found = search_planes(*cameras_of(data), float(near), float(far), spec.coarse_planes)
        yield exact("planes", data["coarse_disparities"], found, "homography")


def undistorted(data: Arrays) -> Iterator[Compared]:
    """The photos without the distortion of their lens, from the originals."""
    rows = None
    for i, camera in enumerate(cameras_of(data)[0]):
        if f"original{i}.photo" not in data:
            continue
        lens = {name: float(data[f"original{i}.{name}"]) for name in ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")}
        k, p = tuple(lens[f"k{n}"] for n in range(1, 7)), (lens["p1"], lens["p2"])
        model = Distortion(bool(data[f"original{i}.fisheye"]), k, p)
        photo = torch.from_numpy(data[f"original{i}.photo"]).permute(2, 0, 1)
        both = [undistort(photo.to(dtype), camera.k, model).permute(1, 2, 0).numpy() for dtype in BOTH]
        row = Compared.of("undistorted", (data[f"view{i}.image"], *both))
        rows = row if rows is None else rows.joined(row)
    if rows:
        yield rows
