"""Extreme cameras and planes: a target and one view of a scene, with one quantity varied at a
time."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import atan, cos, inf, log2, pi, sin
from pathlib import Path

import numpy as np
import torch

from ...extension import liveview
from ...reference.liveview import Camera
from .case import Case, decades, exponent
from .warp import BOUND, Warp

WIDTH = 126  # of the photos, pixels: failures do not depend on the size


@dataclass
class Parts:
    """A camera that can be changed."""

    k: np.ndarray
    rotation: np.ndarray
    centre: np.ndarray  # in the world, scene units
    width: int
    height: int

    @classmethod
    def of(cls, camera) -> "Parts":
        return cls(camera.k, camera.rotation, camera.centre, camera.width, camera.height)

    def copy(self) -> "Parts":
        return replace(self, k=self.k.copy(), rotation=self.rotation.copy(), centre=self.centre.copy())

    def camera(self) -> Camera:
        parts = self.k, self.rotation, -(self.rotation @ self.centre)
        return Camera(*map(torch.from_numpy, parts), self.width, self.height)

    def zoom(self, factor: float) -> None:
        self.k[:2, :2] *= factor

    def centred(self) -> None:
        """Moves the principal point to the centre of a pixel in the middle of the picture."""
        self.k[:2, 2] = self.width // 2 + 0.5, self.height // 2 + 0.5

    def turn(self, angle: float) -> None:
        """To the right, radians."""
        c, s = cos(angle), sin(angle)
        self.rotation = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) @ self.rotation


@dataclass
class Rig:
    """The rig that the cases are derived from: a target, its farthest view, and the depth of a
    plane in the middle of the scene, scene units."""

    photo: np.ndarray  # [3, h, w]
    source: Parts
    target: Parts
    depth: float
    distances: np.ndarray  # of all views' centres to the target's, nearest first
    about: str

    @classmethod
    def of(cls, folder: Path, target: str, views: int) -> "Rig":
        """That of a scene and a held-out view."""
        scene = liveview.Scene(folder, width=WIDTH)
        others = [i for i, name in enumerate(scene.names) if target not in (name, Path(name).stem)]
        if len(others) != len(scene) - 1:
            raise ValueError(f"--target {target}: expected one of {', '.join(scene.names)}")
        (camera,) = (scene.cameras[i] for i in range(len(scene)) if i not in others)
        chosen = [others[i] for i in liveview.choose_views([scene.cameras[i] for i in others], camera, views)]
        known = [scene.depth_ranges[i] for i in chosen if scene.depth_ranges[i]]
        known = known or [liveview.Synthesizer(scene).depth(chosen[0]).range]  # as found from the photos
        near, far = min(near for near, _ in known), max(far for _, far in known)
        source = scene.cameras[chosen[-1]]
        names = ", ".join(scene.names[i] for i in chosen)
        return cls(
            photo=np.ascontiguousarray(scene.photo(chosen[-1]).transpose(2, 0, 1)),
            source=Parts.of(source),
            target=Parts.of(camera),
            depth=1 / float(np.float32(0.5 / near + 0.5 / far)),  # as the pixels' disparities are rounded
            distances=liveview.view_distances([scene.cameras[i] for i in chosen], camera),
            about=f"{folder}, target {target}, views {names} ({source.width}x{source.height})",
        )

    def copy(self) -> "Rig":
        return replace(self, source=self.source.copy(), target=self.target.copy())

    def align(self, *offset: float) -> None:
        """Gives the source the target's rotation, and moves it from the target by `offset`, in the
        target's axes and in units of the depth. Both principal points are on the centre of a
        pixel."""
        self.target.centred()
        self.source.centred()
        self.source.rotation = self.target.rotation
        self.source.centre = self.target.centre + self.target.rotation.T @ np.array(offset) * self.depth

    def warp(self) -> Warp:
        return Warp(self.photo, self.source.camera(), self.target.camera(), 1 / self.depth)


BEHIND = np.array([0.02, -0.01, -0.3])  # the target: the source covers the plane at any depth and any baseline


def depth(rig: Rig, times: float) -> None:
    rig.align(*BEHIND)
    rig.depth *= times


def baseline(rig: Rig, times: float) -> None:
    rig.align(*(BEHIND * times))


def focal(rig: Rig, factor: float) -> None:
    """The longer the focal length, the smaller the offset and the rotation, so that the source
    covers as much."""
    rig.align(0.05 / factor, -0.02 / factor, 0)
    rig.source.zoom(factor)
    rig.target.zoom(factor)
    rig.source.turn(0.05 / max(factor, 1))


def source_focal(rig: Rig, factor: float) -> None:
    """Offset along the common optical axis, which any focal length covers."""
    rig.align(0, 0, -0.3)
    rig.source.zoom(factor)


def through_centre(rig: Rig, gap: float) -> None:
    """The point in the middle of the picture is at (gap / 10, 0, gap) in the source: covered
    however near it is."""
    rig.align(-0.1 * gap, 0, 1 - gap)


def turned(rig: Rig, angle: float, wider: float = 0.125) -> None:
    rig.align(0.05, -0.02, 0.03)
    rig.source.zoom(wider)
    rig.source.turn(angle)


def edge_on(rig: Rig, gap: float) -> None:
    """The source looks along the plane, from this distance beside the point in the middle of the
    picture: w changes its sign there."""
    rig.align(-gap, 0, 1)
    rig.source.turn(pi / 2)


def skew(rig: Rig, times: float) -> None:
    """Does not move the row in the middle of the picture, at the height of both cameras."""
    rig.align(0.05, 0, 0)
    rig.source.k[0, 1] = times * rig.source.k[0, 0]


def principal_point(rig: Rig, pixels: float) -> None:
    """A picture far off its camera's optical axis; the camera is turned so that it covers what the
    target shows."""
    rig.align(0, 0, -0.3)
    rig.source.turn(atan(pixels / rig.source.k[0, 0]))
    rig.source.k[0, 2] += pixels


def unit(rig: Rig, factor: float) -> None:
    rig.source.centre *= factor
    rig.target.centre *= factor
    rig.depth *= factor


def origin(rig: Rig, away: float) -> None:
    by = np.array([0.6, -0.48, 0.64]) * away * rig.depth
    rig.source.centre += by
    rig.target.centre += by


def families(rig: Rig) -> list[list[Case]]:
    def family(name: str, extremes: Iterable[float], change: Callable[[Rig, float], None], **options) -> list[Case]:
        cases = []
        for extreme in extremes:
            changed = rig.copy()
            change(changed, extreme)
            cases.append(Case(name, exponent(extreme), replace(changed.warp(), **options), BOUND))
        return cases

    near_centre = family("plane near a source centre", [*decades(*range(-15, 1)), 0.0], through_centre)
    near_centre[-1].inputs.must_cover = False
    units = [2.0 ** (20 * step) for step in range(-6, 7)]
    unit_cases = family("scene unit", units, unit, equivalent_rig=rig.warp())
    away = decades(*range(11))
    far_cases = family("far from the origin", away, origin, well_conditioned=rig.warp())
    for case, factor in zip(unit_cases, units, strict=True):
        case.name = f"2^{log2(factor):.0f}"
    for case, extreme in zip(far_cases, away, strict=True):
        # The rounding error of float64 positions this far from the origin, in pixels by the focal
        # length. Ten times further, a last bit of these is more than a step of an 8-bit photo
        # (1/256): no useful bound.
        last_bit = 8 * np.finfo(np.float64).eps * extreme
        case.bound = max(BOUND, last_bit * max(rig.target.k[0, 0], rig.source.k[0, 0]))
    before, beyond = "vanishing line, before 90°", "vanishing line, beyond 90°"
    return [
        family("depth", [*decades(*range(-6, 10)), inf], depth),
        family("focal length", decades(*range(-6, 7)), focal),
        family("source's focal length", decades(*range(-6, 7)), source_focal),
        near_centre,
        # At smaller gaps, float64 does not determine the position in the photo either.
        family("plane seen edge-on", decades(*range(-10, 1)), edge_on),
        family(before, decades(*range(-3, 1)), lambda rig, by: turned(rig, pi / 2 - by)),
        family(beyond, decades(*range(-3, 0)), lambda rig, by: turned(rig, pi / 2 + by)),
        family("facing away", [1.0, 1e-3, 0.0], lambda rig, by: turned(rig, pi - by, 1), must_cover=False),
        family("baseline", decades(*range(-16, 10)), baseline),
        family("skew", decades(*range(-6, 7)), skew),
        family("far principal point", decades(*range(8)), principal_point),
        unit_cases,
        far_cases,
    ]
