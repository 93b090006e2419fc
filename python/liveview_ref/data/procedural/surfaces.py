"""Flat surfaces of procedural scenes, intersected with the rays of all cameras at once;
painting of surfaces."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from .textures import Textures, lookup, mip_atlas, shape_distance
from .world import Fragments, World


@dataclass
class Pane:
    """A bounded or unbounded piece of plane normal . X = 1 with axes a, b from its centre; cell:
    shape (-1: none)."""

    centre: np.ndarray
    normal: np.ndarray
    a: np.ndarray
    b: np.ndarray
    half: tuple[float, float]
    disparity: float
    soft: float


def pane(rng: np.random.Generator, world: World, x, y, disparity, tilt, half_pixels, bounded=True) -> Pane:
    """A plane through target pixel (x, y) at a disparity, tilted (less if it would leave the
    world's depths)."""
    centre = world.point(x, y, disparity)
    facing = centre / np.linalg.norm(centre)
    focal, largest = world.focal[0], max(half_pixels)
    room = max(min(1.15 - disparity, disparity - world.farthest * 0.8), 1e-3)
    tilt = min(tilt, np.arctan(room * focal / (disparity * largest)))
    side = cross(facing, rng.normal(0, 1, 3) * [1, 1, 0.1])
    side /= np.linalg.norm(side)
    unit = facing * np.cos(tilt) + cross(side, facing) * np.sin(tilt)
    roll = rng.choice([0, rng.uniform(0, np.pi)])
    a = np.array([np.cos(roll), np.sin(roll), 0])
    a -= unit * (unit @ a)
    a /= np.linalg.norm(a)
    pixel = 1 / (disparity * focal)
    half = (half_pixels[0] * pixel, half_pixels[1] * pixel) if bounded else (np.inf, np.inf)
    return Pane(centre, unit / (unit @ centre), a, cross(unit, a), half, disparity, disparity * np.tan(tilt) / focal)


@dataclass
class Look:
    """The look of a surface: texture atlas, texels per target pixel, origin, tints, gloss."""

    atlas: Tensor
    density: float
    shift: np.ndarray  # [M, 2] texels: position of the centre
    tint: np.ndarray  # [M, 3]
    gloss: tuple[float, float, np.ndarray] | None = None  # strength, exponent, direction of the mirrored light


def look(rng, world: World, textures: Textures, extent: float, count: int = 1, centre=None, normal=None) -> Look:
    """A random look for surfaces of `extent` pixels."""
    size = int(np.clip(np.ceil(extent * 1.25 / 8), 4, 32)) * 8
    spread = 0.12 if count > 1 else 0.0
    tint = np.exp(rng.normal(0, spread, (count, 1)) + rng.normal(0, spread / 2, (count, 3)))
    gloss = None
    if centre is not None and rng.random() < 0.12:
        gloss = highlight(rng, centre, normal)
    shift = rng.uniform(0, 2 * size, (count, 2)) if count > 1 else rng.uniform(0.45, 0.55, (1, 2)) * size
    return Look(mip_atlas(textures.patch(rng, size)), rng.uniform(1.0, 1.25), shift, tint, gloss)


def highlight(rng, centre: np.ndarray, normal: np.ndarray, polished: bool = False) -> tuple[float, float, np.ndarray]:
    """The gloss of a surface with a highlight near its centre; of a polished one it is wider and
    stronger, as of a window or a lamp."""
    towards = centre / np.linalg.norm(centre)
    unit = normal / np.linalg.norm(normal)
    light = towards - 2 * (towards @ unit) * unit + rng.normal(0, 0.1 if polished else 0.04, 3)
    strength, power = ((0.2, 0.8), (2.5, 7)) if polished else ((0.1, 0.5), (4.5, 7))
    return rng.uniform(*strength), np.exp(rng.uniform(*power)), light / np.linalg.norm(light)


def paint(world: World, style: Look, u: Tensor, v: Tensor, footprint: Tensor, texel: float, tint: Tensor) -> Tensor:
    """Colour [3, K] at texture coordinates u, v (texels), from the footprint (scene units); tint
    [3, K] or [3, 1]."""
    return lookup(style.atlas, u, v, torch.log2(footprint * (1 / texel))) * tint


def shine(style: Look, colour: Tensor, rays: Tensor, normal: Tensor, along: Tensor) -> Tensor:
    """Add the highlight: rays, unit normals [3, K] (or [3, 1]) and their product `along` [K]."""
    if style.gloss is None:
        return colour.clamp(0, 1)
    strength, power, light = style.gloss
    light = torch.tensor(light, dtype=torch.float32)
    mirrored = light @ rays - 2 * along * (light @ normal)
    cosine = (mirrored / length(rays)).clamp(0, 1)
    return (colour + strength * cosine**power).clamp(0, 1)


def draw_panes(world: World, panes: list[Pane], style: Look, cut, whole=False) -> list[Fragments]:
    """Intersect, cut out and paint panes that share a texture. cut(x, y, pixel, rows) -> alpha [K]
    from coordinates in scene units along a and b and the size of a pixel there; rows: the pane of
    each. `whole`: it covers every pixel."""
    cameras, count = len(world.sizes), len(panes)
    centre, normal, a, b = (np.stack([getattr(p, name) for p in panes]) for name in ("centre", "normal", "a", "b"))
    boxes = None
    if not whole:
        half = np.array([p.half for p in panes])
        corners = [centre + a * half[:, :1] * i + b * half[:, 1:] * j for i in (-1, 1) for j in (-1, 1)]
        boxes = world.boxes(np.stack(corners, 1))
    pixels, rows, counts = world.pixels(boxes)
    if len(rows) == 0:
        return []
    # Per pane and camera: normal . ray, a . ray, b . ray are affine in the pixel; the rest is
    # constant.
    affine = np.einsum("mvi,cij->mcvj", np.stack([normal, a, b], 1), world.rays_of).reshape(count * cameras, 9)
    offset = world.origins[None] - centre[:, None]
    constants = [np.einsum("mci,mi->mc", offset, axis) for axis in (a, b)]
    rest = np.stack([-np.einsum("mci,mi->mc", offset, normal), *constants], -1).reshape(-1, 3)
    steep = np.linalg.norm(normal, axis=1)[:, None] * world.focal[None]
    inverse_focal = np.broadcast_to(1 / world.focal, (count, cameras))
    texel = 1 / (np.array([p.disparity for p in panes]) * world.focal[0] * style.density)
    table = np.concatenate([affine, rest, steep.reshape(-1, 1), inverse_focal.reshape(-1, 1)], 1)
    table = torch.from_numpy(np.ascontiguousarray(table.T)).float().index_select(1, rows)
    x, y = world.xy if pixels is None else world.xy.index_select(1, pixels)
    n_ray, a_ray, b_ray = (table[i] * x + table[i + 1] * y + table[i + 2] for i in (0, 3, 6))
    hit = (n_ray > 0) & (table[9] > 0)
    disparity = torch.where(hit, n_ray / table[9], 0.0).clamp(min=world.farthest * 0.2)
    depth = 1 / disparity
    u, v = table[10] + depth * a_ray, table[11] + depth * b_ray
    pixel = depth * table[13]
    slant = (table[12] * table[13] / n_ray.clamp(min=1e-6)).clamp(1, 6)  # about 1 / cos of the incidence
    pane_of = torch.div(rows, cameras, rounding_mode="floor") if count > 1 else None
    alpha = cut(u, v, pixel * slant**0.5, pane_of) * hit
    if not whole:  # most of the box is empty
        kept = (alpha > 0).nonzero()[:, 0]
        if len(kept) == 0:
            return []
        if len(kept) < 0.75 * len(alpha):
            parts = torch.stack([u, v, pixel, slant, n_ray, disparity, alpha]).index_select(1, kept)
            u, v, pixel, slant, n_ray, disparity, alpha = parts
            pixels = pixels[kept]
            if count > 1:
                pane_of = pane_of[kept]
                counts = torch.bincount(pane_of, minlength=count).numpy()
    per_pane = np.concatenate([style.shift, 1 / texel[:, None], style.tint], 1).astype(np.float32)
    per_pane = torch.from_numpy(np.ascontiguousarray(per_pane.T))
    per_pane = per_pane.index_select(1, pane_of) if count > 1 else per_pane
    footprint = pixel * slant**0.75 * per_pane[2]
    colour = paint(
        world, style, per_pane[0] + u * per_pane[2], per_pane[1] + v * per_pane[2], footprint, 1.0, per_pane[3:]
    )
    if style.gloss is not None:
        unit = torch.from_numpy(normal[:1].T / np.linalg.norm(normal[0])).float()
        rays = world.rays if pixels is None else world.rays.index_select(1, pixels)
        colour = shine(style, colour, rays, unit, n_ray / float(np.linalg.norm(normal[0])))
    else:
        colour = colour.clamp(0, 1)
    if count == 1:
        return [Fragments(panes[0].disparity, pixels, colour, alpha, disparity, max(panes[0].soft, 1e-6))]
    ends = np.cumsum(counts)
    return [
        Fragments(
            p.disparity,
            pixels[e - n : e],
            colour[:, e - n : e],
            alpha[e - n : e],
            disparity[e - n : e],
            max(p.soft, 1e-6),
        )
        for p, n, e in zip(panes, counts, ends, strict=True)
        if n
    ]


def shape_cut(textures: Textures, panes: list[Pane], cells: np.ndarray):
    """Alpha from the shapes of `cells` [M], one per pane, stretched over it; edges are
    one pixel soft."""
    half = torch.tensor([p.half for p in panes], dtype=torch.float32).T
    cells = torch.from_numpy(cells.astype(np.float32))

    def cut(u, v, pixel, rows):
        hx, hy, cell = (half[0], half[1], cells) if rows is None else (half[0, rows], half[1, rows], cells[rows])
        distance = shape_distance(textures.shapes, u / hx, v / hy, cell.expand_as(u))
        return (distance * torch.minimum(hx, hy) / pixel + 0.5).clamp(0, 1)

    return cut


def slab(x: Tensor, half, pixel: Tensor) -> Tensor:
    """Share of a pixel about x covered by |x| < half: exact for a box filter, also if thinner than
    a pixel."""
    return ((half - x) / pixel + 0.5).clamp(0, 1) - ((-half - x) / pixel + 0.5).clamp(0, 1)


def bars(x: Tensor, period: float, width: float, pixel: Tensor) -> Tensor:
    """Share of a pixel about x covered by infinite bars: exact for a box filter at any scale."""

    def integral(at):
        turns = (at / period).floor()
        return turns * width + (at - turns * period).clamp(max=width)

    return (integral(x + pixel / 2) - integral(x - pixel / 2)) / pixel


def grating_cut(rng: np.random.Generator, world: World, p: Pane):
    """Alpha of fences, grids, slats: bars 1 to 6 pixels wide, some shorter than their pane."""
    unit = 1 / (p.disparity * world.focal[0])
    width = np.exp(rng.uniform(np.log(0.8), np.log(6))) * unit
    period = width + np.exp(rng.uniform(np.log(3), np.log(30))) * unit
    kind = rng.integers(4)
    cross_period, cross_width = period * rng.choice([1, 1, 3]), width * rng.choice([0.5, 1, 1.5])

    def cut(u, v, pixel, rows):
        alpha = bars(u, period, width, pixel)
        if kind == 1:  # grid
            alpha = 1 - (1 - alpha) * (1 - bars(v, cross_period, cross_width, pixel))
        elif kind == 2:  # fence with two rails
            alpha = 1 - (1 - alpha) * (1 - slab(v.abs() - p.half[1] * 0.5, width * 0.5, pixel))
        if kind == 3:
            return alpha
        return alpha * slab(u, p.half[0], pixel) * slab(v, p.half[1], pixel)

    return cut


def length(vectors: Tensor) -> Tensor:
    """[3, K] -> [K]; torch's norm over the first dimension is slow."""
    return (vectors[0] ** 2 + vectors[1] ** 2 + vectors[2] ** 2).sqrt()


def cross(a, b) -> np.ndarray:
    """Cross product of two vectors; numpy's is slow for so few numbers."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def everything(u, v, pixel, rows):
    """A cut that keeps the whole pane."""
    return torch.ones_like(u)
