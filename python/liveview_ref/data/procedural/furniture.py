"""Furniture of rooms, along the room's axes: boxes, tables, screens, lattices, posts, balls."""

import numpy as np
import torch

from .bodies import round_body
from .surfaces import Look, Pane, draw_panes, grating_cut, highlight, look, shape_cut
from .textures import Textures, mip_atlas, noise
from .world import Fragments, World


def plain_look(rng, world: World, textures: Textures, extent: float, count: int = 1, centre=None, normal=None) -> Look:
    """A look of nearly one colour, as of painted walls and plastic: only the light changes
    slowly."""
    style = look(rng, world, textures, extent, count, centre, normal)
    size = style.atlas.shape[2]
    colour = torch.from_numpy(rng.beta(1.2, 0.8, (3, 1, 1)).astype(np.float32))
    colour = torch.lerp(colour.mean(0, keepdim=True).expand(3, 1, 1), colour, float(rng.uniform(0, 0.6) ** 1.5))
    style.atlas = mip_atlas((colour + noise(rng, size, 2) * float(rng.uniform(0, 0.05))).clamp(0, 1))
    return style


def any_look(rng, world: World, textures: Textures, extent: float, count: int = 1, centre=None, normal=None) -> Look:
    make = plain_look if rng.random() < 0.4 else look
    return make(rng, world, textures, extent, count, centre, normal)


def softness(world: World, normal: np.ndarray) -> float:
    """The change of disparity per pixel of a plane normal . X = 1: it intersects others softly over
    this range."""
    return max(float(np.hypot(*normal[:2])) / world.focal[0], 1e-6)


def plane(world: World, centre: np.ndarray, unit: np.ndarray, a: np.ndarray, b: np.ndarray, half) -> Pane | None:
    """A piece of plane about a centre with unit normal and axes a and b; None if seen
    edge-on."""
    towards = unit @ centre
    if abs(towards) < 1e-3 * np.linalg.norm(centre) or centre[2] < 0.05:
        return None
    normal = unit / towards
    return Pane(centre, normal, a, b, tuple(half), 1 / float(centre[2]), softness(world, normal))


def yawed(rng, axes: np.ndarray) -> np.ndarray:
    """The room's axes, often turned about the vertical."""
    angle = rng.choice([0, rng.uniform(0, np.pi)], p=[0.4, 0.6])
    c, s = np.cos(angle), np.sin(angle)
    right, down, forwards = axes
    return np.stack([c * right + s * forwards, down, c * forwards - s * right])


def draw_box(world: World, style: Look, centre: np.ndarray, axes: np.ndarray, half: np.ndarray) -> list[Fragments]:
    """All six sides of a cuboid of one texture; a side that does not face the target shows its
    inside."""
    sides = []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for sign in (-1, 1):
            sides.append(plane(world, centre + sign * half[i] * axes[i], axes[i], axes[j], axes[k], (half[j], half[k])))
    kept = [i for i, side in enumerate(sides) if side is not None]
    sides = [sides[i] for i in kept]
    style.shift, style.tint = style.shift[kept], style.tint[kept]
    halves = torch.tensor([p.half for p in sides], dtype=torch.float32).T

    def cut(u, v, pixel, rows):
        hu, hv = halves[:, rows]
        return ((hu - u.abs()) / pixel + 0.5).clamp(0, 1) * ((hv - v.abs()) / pixel + 0.5).clamp(0, 1)

    return draw_panes(world, sides, style, cut)


def sizes(rng, world: World, disparity: float, low: float, high: float, count: int) -> np.ndarray:
    """Half sizes in scene units, between shares of the crop's larger side."""
    pixels = max(world.size) * np.exp(rng.uniform(np.log(low), np.log(high), count))
    return pixels / (disparity * world.focal[0])


def box(rng, world: World, textures: Textures, axes, x, y, disparity) -> list[Fragments]:
    half = sizes(rng, world, disparity, 0.05, 0.3, 3)
    half[2] = min(half[2], 0.5 / disparity)
    style = any_look(rng, world, textures, 2 * float(half.max()) * disparity * world.focal[0], 6)
    return draw_box(world, style, world.point(x, y, disparity), yawed(rng, axes), half)


def table(rng, world: World, textures: Textures, axes, x, y, disparity) -> list[Fragments]:
    """A top, often polished, above a thin slab, and posts as legs."""
    axes, centre = yawed(rng, axes), world.point(x, y, disparity)
    half = sizes(rng, world, disparity, 0.3, 0.9, 2)
    half[1] = min(half[1], 0.5 / disparity)
    right, down, forwards = axes
    extent = 2 * float(half.max()) * disparity * world.focal[0]
    thick = sizes(rng, world, disparity, 0.005, 0.03, 1)[0]
    slab = np.array([half[0], thick, half[1]])
    found = draw_box(world, any_look(rng, world, textures, extent, 6), centre + 1.1 * thick * down, axes, slab)
    top = plane(world, centre, down, right, forwards, half)
    if top is not None:
        style = any_look(rng, world, textures, extent, 1, centre, down)
        if rng.random() < 0.6:
            style.gloss = highlight(rng, centre, down, polished=True)
        found += draw_panes(world, [top], style, shape_cut(textures, [top], np.array([0])))
    for _ in range(rng.integers(0, 3)):
        found += post(rng, world, textures, axes, x + rng.normal(0, 0.2) * world.size[1], y, disparity * 0.98)
    return found


def screen(rng, world: World, textures: Textures, axes, x, y, disparity) -> list[Fragments]:
    """A dark frame with a glossy picture or a dark pane in it."""
    axes, centre = yawed(rng, axes), world.point(x, y, disparity)
    half = sizes(rng, world, disparity, 0.12, 0.45, 1)[0] * np.array([1, rng.uniform(0.5, 0.8), 0.03])
    right, down, forwards = axes
    extent = 2 * float(half[0]) * disparity * world.focal[0]
    frame = plain_look(rng, world, textures, extent, 6)
    frame.atlas = frame.atlas * float(rng.uniform(0.05, 0.4))
    front = -forwards if forwards @ centre > 0 else forwards
    found = draw_box(world, frame, centre - 1.1 * half[2] * front, axes, half)
    pane = plane(world, centre, front, right, down, half[:2] * 0.95)
    if pane is not None:
        style = look(rng, world, textures, extent, 1, centre, front)
        style.atlas = style.atlas * (0.08 if rng.random() < 0.4 else 1.0)  # switched off
        style.gloss = highlight(rng, centre, front, polished=True)
        found += draw_panes(world, [pane], style, shape_cut(textures, [pane], np.array([0])))
    return found


def lattice(rng, world: World, textures: Textures, axes, x, y, disparity) -> list[Fragments]:
    """Bars, rails, shelves or a grid in an upright plane."""
    axes, centre = yawed(rng, axes), world.point(x, y, disparity)
    p = plane(world, centre, axes[2], axes[0], axes[1], sizes(rng, world, disparity, 0.25, 0.9, 2))
    if p is None:
        return []
    style = any_look(rng, world, textures, 2 * max(p.half) * disparity * world.focal[0], 1, p.centre, p.normal)
    return draw_panes(world, [p], style, grating_cut(rng, world, p))


def post(rng, world: World, textures: Textures, axes, x, y, disparity) -> list[Fragments]:
    """A lamp post or a leg: an upright cylinder of 1 to 10 pixels, sometimes with a ball."""
    radius = float(np.exp(rng.uniform(np.log(0.5), np.log(5))))
    found = round_body(rng, world, textures, x, y, disparity, radius, "cylinder", axes[1])
    if rng.random() < 0.3:
        above = y - rng.uniform(0.1, 0.5) * world.size[0]
        found += round_body(rng, world, textures, x, above, disparity, radius * rng.uniform(2, 5), "ball")
    return found


def ball(rng, world: World, textures: Textures, axes, x, y, disparity) -> list[Fragments]:
    """A ball, a bottle or a can."""
    radius = max(world.size) * float(np.exp(rng.uniform(np.log(0.04), np.log(0.2))))
    kind = rng.choice(["ball", "cylinder"])
    return round_body(rng, world, textures, x, y, disparity, radius, kind, axes[1])


FURNITURE = {  # kinds, and their frequencies
    "box": (box, 0.3),
    "table": (table, 0.15),
    "screen": (screen, 0.12),
    "lattice": (lattice, 0.15),
    "post": (post, 0.15),
    "ball": (ball, 0.13),
}
