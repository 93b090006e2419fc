"""Cameras to and from nerfstudio, COLMAP and OpenCV, without lens distortion (a scene's folder may
have it, which `Scene` undoes; `liveview.undistort` does it with arrays). Lengths are scene units,
intrinsics pixels."""

from __future__ import annotations  # `help()` shows ArrayLike, not what it stands for

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ._liveview import Camera

_DISTORTION = "k1", "k2", "k3", "k4", "p1", "p2"


def from_nerfstudio(transforms: Mapping[str, Any]) -> dict[str, Camera]:
    """The cameras of a transforms.json by `file_path`; fields of a frame go before those of the
    file."""
    found = {}
    for index, frame in enumerate(transforms["frames"]):
        fields = {**transforms, **frame}
        name = fields.get("file_path", f"frame {index}")
        if distorted := [field for field in _DISTORTION if fields.get(field)]:
            raise ValueError(f"transforms: {name} has {', '.join(distorted)}; expected no distortion")
        if missing := [field for field in ("fl_x", "cx", "cy", "w", "h", "transform_matrix") if field not in fields]:
            raise ValueError(f"transforms: {name} has no {', '.join(missing)}")
        k = _k(fields["fl_x"], fields.get("fl_y", fields["fl_x"]), fields["cx"], fields["cy"])
        found[name] = Camera(k, fields["transform_matrix"], int(fields["w"]), int(fields["h"]), convention="opengl")
    return found


def to_nerfstudio(cameras: Mapping[str, Camera]) -> dict[str, Any]:
    """A transforms.json of these cameras by `file_path`."""
    return {"camera_model": "PINHOLE", "frames": [_frame(name, camera) for name, camera in cameras.items()]}


def _frame(name: str, camera: Camera) -> dict[str, Any]:
    fx, fy, cx, cy = _pinhole(camera)
    return {
        **{"file_path": name, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "w": camera.width, "h": camera.height},
        "transform_matrix": camera.pose("opengl").tolist(),
    }


def from_colmap(qvec: ArrayLike, tvec: ArrayLike, params: ArrayLike, width: int, height: int) -> Camera:
    """A camera from the quaternion (w, x, y, z) and the translation of COLMAP's image, and the
    parameters fx, fy, cx, cy of its PINHOLE camera."""
    quaternion = np.asarray(qvec, float)
    if quaternion.shape != (4,) or not np.linalg.norm(quaternion) > 0:
        raise ValueError(f"qvec: {qvec}; expected four numbers that are not all 0")
    w, *v = quaternion / np.linalg.norm(quaternion)
    return _placed(np.eye(3) + 2 * w * _cross(v) + 2 * _cross(v) @ _cross(v), tvec, _k(*params), width, height)


def to_colmap(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """qvec (w, x, y, z), tvec, and the parameters fx, fy, cx, cy of COLMAP's PINHOLE camera."""
    return _quaternion(camera.rotation), camera.translation, np.array(_pinhole(camera))


def from_opencv(k: ArrayLike, rvec: ArrayLike, tvec: ArrayLike, width: int, height: int) -> Camera:
    """A camera from K [3, 3] and the rotation vector and translation [3] that `cv2.solvePnP`
    returns."""
    turn = np.asarray(rvec, float).reshape(3)
    angle = np.linalg.norm(turn)
    axis = _cross(turn / angle if angle > 0 else turn)
    return _placed(np.eye(3) + np.sin(angle) * axis + (1 - np.cos(angle)) * axis @ axis, tvec, k, width, height)


def to_opencv(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K [3, 3], and the rotation vector and translation [3] that `cv2.projectPoints` takes."""
    w, *v = _quaternion(camera.rotation)
    sine = np.linalg.norm(v)
    return camera.k, np.array(v) * (2 * np.arctan2(sine, w) / sine if sine > 0 else 2), camera.translation


def _k(fx: float, fy: float, cx: float, cy: float) -> np.ndarray:
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], float)


def _pinhole(camera: Camera) -> tuple[float, float, float, float]:
    (fx, skew, cx), (_, fy, cy), _ = camera.k.tolist()
    if skew:
        raise ValueError(f"camera: its skew is {skew}; expected 0")
    return fx, fy, cx, cy


def _cross(v: ArrayLike) -> np.ndarray:
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _placed(rotation: np.ndarray, tvec: ArrayLike, k: ArrayLike, width: int, height: int) -> Camera:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, np.asarray(tvec, float).reshape(3)
    return Camera(k, pose, width, height)


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    """(w, x, y, z) with w >= 0: the eigenvector of the largest eigenvalue (Bar-Itzhack, 2000)."""
    r = rotation
    symmetric = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
            [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
            [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], 0],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)],
        ]
    )
    found = np.linalg.eigh(symmetric / 3)[1][[3, 0, 1, 2], -1]
    return -found if found[0] < 0 else found
