"""Posed photos for training and evaluation: transforms.json, LLFF, RealEstate10K and COLMAP
folders -> cameras.

The Rust crate's loader reads more formats, with checks; this one reads those of
training and evaluation.
"""

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from ..reference.liveview import Camera
from ..reference.undistort import Distortion, undistort
from .image import picture


def flip_axes(world_from_cam: np.ndarray) -> np.ndarray:
    """A pose [3, 4] or [4, 4] with OpenGL camera axes (y up, z backwards) -> with OpenCV's
    (y down, z forward), or the reverse."""
    return world_from_cam @ np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass
class Scene:
    """names[i], cameras[i], bounds[i] = (near, far) or None; images are read on demand."""

    root: Path
    names: list[str] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    bounds: list[tuple[float, float] | None] = field(default_factory=list)
    distortion: Distortion = Distortion()

    def add(self, name: str, k, world_from_cam=None, cam_from_world=None, size=None, bounds=None) -> None:
        """Add a photo. Poses are 4x4 or 3x4, OpenCV axes; K is for `size` (width, height) and is
        scaled to the image."""
        if cam_from_world is None:
            rotation = world_from_cam[:3, :3].T
            translation = -rotation @ world_from_cam[:3, 3]
        else:
            rotation, translation = cam_from_world[:3, :3], cam_from_world[:3, 3]
        with Image.open(self.root / name) as image:
            actual = image.size
        r, t, k = (torch.from_numpy(np.array(x, dtype=np.float64)) for x in (rotation, translation, k))
        camera = Camera(k, r, t, *(size or actual))
        self.names.append(name)
        self.cameras.append(camera if size in (None, actual) else camera.with_size_scaled(*actual))
        self.bounds.append(bounds)

    def image_u8(self, index: int) -> Tensor:
        """The photo, [3, H, W] uint8, lens distortion undone."""
        with Image.open(self.root / self.names[index]) as image:
            x = torch.from_numpy(np.array(image.convert("RGB"))).permute(2, 0, 1)
        if self.distortion != Distortion():
            x = (undistort(x.float(), self.cameras[index].k, self.distortion)).round().to(torch.uint8)
        return x.contiguous()


def intrinsics(fx, fy, cx, cy) -> np.ndarray:
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=np.float64)


def distortion(data: dict) -> Distortion:
    """The lens of a transforms.json."""
    fisheye = data.get("is_fisheye", False) or data.get("camera_model", "OPENCV").endswith("FISHEYE")
    k = tuple(data.get(f"k{i}", 0.0) for i in range(1, 7))
    return Distortion(fisheye, k, (data.get("p1", 0.0), data.get("p2", 0.0)))


def load_transforms(root: Path) -> Scene:
    data = json.loads((root / "transforms.json").read_text())
    scene = Scene(root, distortion=distortion(data))
    for frame in sorted(data["frames"], key=lambda f: f["file_path"]):
        at = {**data, **frame}
        k = intrinsics(at["fl_x"], at["fl_y"], at["cx"], at["cy"])
        size = (int(at["w"]), int(at["h"]))
        bounds = (at["near"], at["far"]) if "near" in at else None
        scene.add(frame["file_path"], k, flip_axes(np.array(frame["transform_matrix"])), size=size, bounds=bounds)
    return scene


def load_llff(root: Path) -> Scene:
    rows = np.load(root / "poses_bounds.npy")
    folder = next(f for f in ("images_8", "images_4", "images_2", "images") if (root / f).is_dir())
    names = sorted(f"{folder}/{p.name}" for p in (root / folder).iterdir())
    if len(names) != len(rows):
        raise ValueError(f"{root}: {len(names)} images in {folder} but {len(rows)} rows in poses_bounds.npy")
    scene = Scene(root)
    for name, row in zip(names, rows, strict=True):
        pose, (height, width, focal) = row[:15].reshape(3, 5)[:, :4], row[:15].reshape(3, 5)[:, 4]
        down, right, backwards, centre = pose.T
        world_from_cam = np.stack([right, down, -backwards, centre], 1)
        k = intrinsics(focal, focal, width / 2, height / 2)
        scene.add(name, k, world_from_cam, size=(int(width), int(height)), bounds=(row[15], row[16]))
    return scene


def load_realestate10k(root: Path, file: str = "cameras.txt") -> Scene:
    scene = Scene(root)
    frames = {p.stem: p.name for p in (root / "frames").iterdir()}
    for line in (root / file).read_text().splitlines()[1:]:
        stamp, *numbers = line.split()
        fx, fy, cx, cy, _, _, *pose = map(float, numbers)
        if stamp in frames:
            with Image.open(root / "frames" / frames[stamp]) as image:
                width, height = image.size
            k = intrinsics(fx * width, fy * height, cx * width, cy * height)
            scene.add(f"frames/{frames[stamp]}", k, cam_from_world=np.array(pose).reshape(3, 4))
    return scene


def load_colmap(root: Path) -> Scene:
    sparse = root / "sparse" / "0"
    cameras, points, images = (colmap_text if (sparse / "images.txt").exists() else colmap_binary)(sparse)
    scene = Scene(root)
    for name, pose, camera, track in sorted(images):
        pose, (k, size) = quaternion_pose(pose), cameras[camera]
        depth = np.array([points[i] for i in track if i in points]) @ pose[2, :3] + pose[2, 3]
        near, far = np.percentile(depth, [1, 99])
        scene.add(f"images/{name}", k, cam_from_world=pose, size=size, bounds=(0.9 * near, 1.1 * far))
    return scene


def pinhole(model: int | str, *parameters: float) -> np.ndarray:
    if model not in (0, 1, "SIMPLE_PINHOLE", "PINHOLE"):
        raise ValueError(f"camera model {model}; expected SIMPLE_PINHOLE or PINHOLE")
    *focal, cx, cy = parameters
    return intrinsics(focal[0], focal[-1], cx, cy)


def colmap_text(sparse: Path):
    """cameras {id: (K, (width, height))}, points {id: (x, y, z)}, images [(name, (qw, qx, qy, qz,
    tx, ty, tz), camera, ids of the points in it)]."""

    def lines(name: str) -> list[list[str]]:
        return [line.split() for line in (sparse / name).read_text().splitlines() if not line.startswith("#")]

    cameras = {}
    for camera, model, width, height, *parameters in filter(None, lines("cameras.txt")):
        cameras[int(camera)] = (pinhole(model, *map(float, parameters)), (int(width), int(height)))
    points = {int(point): (float(x), float(y), float(z)) for point, x, y, z, *_ in filter(None, lines("points3D.txt"))}
    images, rows = [], iter(lines("images.txt"))
    for _, *row in rows:  # two lines per image; the second is empty if it has no points
        name, track = " ".join(row[8:]), [int(point) for point in next(rows, [])[2::3]]
        images.append((name, tuple(map(float, row[:7])), int(row[7]), track))
    return cameras, points, images


def colmap_binary(sparse: Path):
    """As `colmap_text`, from the binary files."""
    cameras = {}
    for _, ((camera, model, width, height), reader) in _records(sparse / "cameras.bin", "<iiQQ"):
        cameras[camera] = (pinhole(model, *reader("<dddd" if model else "<ddd")), (width, height))
    points = {}
    for _, ((point, x, y, z, *_), reader) in _records(sparse / "points3D.bin", "<QdddBBBd"):
        points[point] = (x, y, z)
        reader(f"<{2 * reader('<Q')[0]}i")
    images = []
    for _, ((_, *pose, camera), reader) in _records(sparse / "images.bin", "<idddddddi"):
        name = b"".join(iter(lambda reader=reader: reader("<c")[0], b"\0")).decode()
        track = np.frombuffer(reader(f"{24 * reader('<Q')[0]}s")[0], dtype="<f8,<f8,<i8")["f2"]
        images.append((name, tuple(pose), camera, track.tolist()))
    return cameras, points, images


def quaternion_pose(pose) -> np.ndarray:
    """(qw, qx, qy, qz, tx, ty, tz) -> cam_from_world [3, 4]."""
    w, x, y, z = np.array(pose[:4]) / np.linalg.norm(pose[:4])
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.column_stack([rotation, pose[4:]])


def _records(path: Path, head: str):
    """Records of a COLMAP binary file: (index, (head fields, reader for the rest))."""
    data, at = path.read_bytes(), 8

    def reader(layout: str):
        nonlocal at
        fields = struct.unpack_from(layout, data, at)
        at += struct.calcsize(layout)
        return fields

    for index in range(struct.unpack_from("<Q", data)[0]):
        yield index, (reader(head), reader)


def open_scene(root: Path, file: str = "cameras.txt") -> Scene:
    """The scene of a folder; its files determine the format."""
    if (root / "transforms.json").exists():
        return load_transforms(root)
    if (root / "poses_bounds.npy").exists():
        return load_llff(root)
    if (root / "cameras.txt").exists():
        return load_realestate10k(root, file)
    return load_colmap(root)


def write_scene(
    folder: Path,
    photos: list[Tensor],
    cameras: list[Camera],
    bounds: tuple[float, float] | None = None,
    lens: dict[str, float] | None = None,
) -> None:
    """Write photos [3, H, W] as 000.png, 001.png ... and transforms.json, for the program. bounds:
    near and far in scene units; lens: distortion, by the names of its fields."""
    frames = []
    for i, (photo, camera) in enumerate(zip(photos, cameras, strict=True)):
        name = f"{i:03}.png"
        picture(photo).save(folder / name, compress_level=1)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = camera.rotation.T.numpy(), camera.centre.numpy()
        (fx, _, cx), (_, fy, cy) = camera.k[:2].tolist()
        frame = {"file_path": name, "w": camera.width, "h": camera.height, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy}
        range_ = {} if bounds is None else dict(zip(("near", "far"), map(float, bounds), strict=True))
        frames.append(frame | range_ | (lens or {}) | {"transform_matrix": flip_axes(pose).tolist()})
    (folder / "transforms.json").write_text(json.dumps({"frames": frames}))
