"""Textures of procedural scenes: patches of photos or generated ones, and cut-out shapes as
distance fields."""

from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image
from torch import Tensor

CELL = 64  # texels of one shape in the shape atlas; a shape's own coordinates run from -1 to 1 across it
COLUMNS = 12
LEVELS = 4


class Textures:
    """Photos under `folder` (mip-mapped) mixed with generated textures, and the library
    of shapes. Immutable."""

    def __init__(self, folder: Path | None = None):
        self.photos: list[list[Tensor]] = []  # per photo: levels 1, 1/2, 1/4 as uint8 [3, H, W]
        files = [] if folder is None else sorted(Path(folder).rglob("*"))
        paths = [path for path in files if path.suffix.lower() in (".jpg", ".jpeg", ".png")]
        for path in paths:
            image = Image.open(path).convert("RGB")
            levels = [image, image.reduce(2), image.reduce(4)]
            self.photos.append([torch.from_numpy(np.array(level)).permute(2, 0, 1).contiguous() for level in levels])
        self.shapes, self.leaves, self.thickets = shape_atlas()

    def patch(self, rng: np.random.Generator, size: int) -> Tensor:
        """A texture [3, size, size] in [0, 1] with about one texel per pixel of
        detail; sometimes smoother."""
        smooth = int(rng.choice([1, 2, 4], p=[0.84, 0.11, 0.05]))
        texels = max(8, size // smooth)
        patch = self._photo(rng, texels) if self.photos and rng.random() < 0.65 else _generated(rng, texels)
        if smooth > 1:
            patch = F.interpolate(patch[None], (size, size), mode="bicubic", align_corners=False)[0]
        return patch.clamp(0, 1)

    def _photo(self, rng: np.random.Generator, size: int) -> Tensor:
        levels = self.photos[rng.integers(len(self.photos))]
        image = levels[rng.integers(1 + sum(min(level.shape[1:]) >= size for level in levels[1:]))]
        spans = []
        for length in image.shape[1:]:
            start = int(rng.integers(0, max(1, length - size + 1)))
            index = torch.arange(start, start + size) % (2 * length)
            spans.append(torch.minimum(index, 2 * length - 1 - index))
        rows, columns = spans
        if size <= min(image.shape[1:]):
            patch = image[:, rows[0] : rows[0] + size, columns[0] : columns[0] + size].float() / 255
        else:
            patch = image[:, rows][:, :, columns].float() / 255
        if rng.random() < 0.5:
            patch = patch.flip(2)
        if rng.random() < 0.3:
            patch = patch.transpose(1, 2)
        if rng.random() < 0.15:  # the same detail in other colours
            patch = patch[torch.from_numpy(rng.permutation(3))]
        patch = torch.lerp(patch.mean(0, keepdim=True), patch, float(rng.uniform(0.2, 1.1)))
        gain = torch.from_numpy(np.exp(rng.normal(0, 0.15, (3, 1, 1))).astype(np.float32))
        lift, contrast = float(rng.normal(0, 0.05)), float(np.exp(rng.normal(0.15, 0.25)))
        mean = patch.mean((1, 2), keepdim=True)
        return ((patch - mean) * contrast + mean * gain + lift).clamp(0, 1)


def mip_atlas(patch: Tensor) -> Tensor:
    """[3, T, T] -> [1, 3, T, 2T]: level l, of size T/2^l, begins at column T (2 - 2^(1-l))."""
    size = patch.shape[1]
    atlas = patch.new_zeros(1, 3, size, 2 * size)
    level, column = patch[None], 0
    for _ in range(LEVELS):
        n = level.shape[2]
        atlas[:, :, :n, column : column + n] = level
        column += n
        level = F.avg_pool2d(level, 2)
    return atlas


def lookup(atlas: Tensor, u: Tensor, v: Tensor, level: Tensor | None) -> Tensor:
    """Trilinear lookup at texel coordinates u, v [K] (mirrored at the borders) and mip level [K] ->
    [3, K]."""
    size = atlas.shape[2]
    u = size - (torch.remainder(u, 2 * size) - size).abs()
    v = size - (torch.remainder(v, 2 * size) - size).abs()
    if level is None or float(level.max()) < 0.2:
        return _at_level(atlas, u.clamp(0.5, size - 0.5), v.clamp(0.5, size - 0.5))
    level = level.clamp(0, LEVELS - 1.001)
    whole = level.floor()
    fine = torch.exp2(-whole)
    values = []
    for shrink in (fine, fine / 2):
        last = size * shrink - 0.5
        x = torch.minimum((u * shrink).clamp(min=0.5), last) + size * (2 - 2 * shrink)
        values.append(_at_level(atlas, x, torch.minimum((v * shrink).clamp(min=0.5), last)))
    return torch.lerp(values[0], values[1], level - whole)


def _at_level(atlas: Tensor, x: Tensor, y: Tensor) -> Tensor:
    height, width = atlas.shape[2:]
    grid = torch.stack([x * (2 / width) - 1, y * (2 / height) - 1], -1)
    return F.grid_sample(atlas, grid[None, None], padding_mode="border", align_corners=False)[0, :, 0]


def shape_distance(shapes: Tensor, x: Tensor, y: Tensor, cell: Tensor) -> Tensor:
    """Signed distance (inside > 0, in units of the shape's coordinates) at x, y [K] in [-1, 1] of
    shapes `cell` [K]."""
    half, edge = CELL / 2, 1 - 1 / CELL
    rows, columns = shapes.shape[2:]
    row = torch.div(cell, COLUMNS, rounding_mode="floor")
    gx = ((x.clamp(-edge, edge) + 1) * half + (cell - row * COLUMNS) * CELL) * (2 / columns) - 1
    gy = ((y.clamp(-edge, edge) + 1) * half + row * CELL) * (2 / rows) - 1
    return F.grid_sample(shapes, torch.stack([gx, gy], -1)[None, None], padding_mode="border", align_corners=False)[
        0, 0, 0
    ]


def noise(rng: np.random.Generator, size: int, cells: int, stretch: int = 1) -> Tensor:
    """Octaves of smooth noise, from `cells` across to one value per two texels: [size, size], about
    unit spread."""
    field, amplitude, power = torch.zeros(1, 1, 1, 1), 1.0, 0.0
    fade = float(rng.uniform(0.45, 0.85))
    while cells <= max(size // 2, 4):  # each octave is smoothed by all later enlargements
        shape = (max(2, cells // stretch), cells)
        field = F.interpolate(field, shape, mode="bilinear", align_corners=False)
        field = field + amplitude * torch.from_numpy(rng.standard_normal((1, 1, *shape), dtype=np.float32))
        power += amplitude**2
        amplitude, cells = amplitude * fade, cells * 2
    return F.interpolate(field, (size, size), mode="bilinear", align_corners=False)[0, 0] * (
        1.3 / max(power, 1e-6) ** 0.5
    )


def _generated(rng: np.random.Generator, size: int) -> Tensor:
    """One of: noise, stripes, checkers, text-like marks, a gradient, nearly flat colour.
    [3, size, size]"""
    colours = torch.from_numpy(rng.beta(0.9, 0.9, (3, 3)).astype(np.float32))[:, :, None, None]
    colours = torch.lerp(colours.mean(1, keepdim=True), colours, float(rng.uniform(0, 0.8) ** 1.3))  # rarely saturated
    grain = float(rng.choice([0, 0.02, 0.06])) * torch.from_numpy(
        rng.standard_normal((1, size, size), dtype=np.float32)
    )
    y, x = torch.meshgrid(torch.arange(size) + 0.5, torch.arange(size) + 0.5, indexing="ij")
    angle, phase = rng.uniform(0, 2 * np.pi, 2)
    along, across = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    kind = rng.choice(6, p=[0.42, 0.12, 0.1, 0.16, 0.1, 0.1])
    period = float(np.exp(rng.uniform(np.log(5), np.log(max(6, size / 3)))))
    if kind == 0:
        value = noise(rng, size, int(rng.integers(2, 12)), stretch=int(rng.choice([1, 1, 1, 6]))) * 0.35 + 0.5
    elif kind in (1, 2):  # edges one texel wide
        duty, slope = rng.uniform(-0.5, 0.5), period / np.pi
        value = ((torch.sin(along * (2 * np.pi / period) + phase) + duty) * slope).clamp(-1, 1)
        if kind == 2:
            value = value * (torch.sin(across * (2 * np.pi / period) + phase) * slope).clamp(-1, 1)
        value = value * 0.5 + 0.5 + noise(rng, size, 4) * rng.uniform(0, 0.15)
    elif kind == 3:
        value = _marks(rng, size) + noise(rng, size, 3) * 0.08
    elif kind == 4:
        value = (along - along.min()) / (along.max() - along.min())
    else:
        value = noise(rng, size, 3) * 0.08 + 0.3
    value = (value * 2).clamp(0, 2)
    low, high = value.clamp(max=1), (value - 1).clamp(min=0)
    return torch.lerp(torch.lerp(colours[0], colours[1], low), colours[2], high).reshape(3, size, size) + grain


def _marks(rng: np.random.Generator, size: int) -> Tensor:
    """Lines of text-like marks: [size, size], 0 paper, 1 ink."""
    stroke = int(rng.integers(1, 4))
    n = size // stroke + 1
    ink = rng.random((n, n)) < rng.uniform(0.4, 0.7)
    leading = int(rng.integers(7, 12))
    ink &= (np.arange(n) % leading < 5)[:, None]
    lines = (np.arange(n) // leading)[:, None]
    gaps = rng.random((n // leading + 1, n // 3 + 1)) < 0.25
    ink &= ~gaps[lines, np.arange(n)[None] // 3]
    wide = torch.from_numpy(np.kron(ink, np.ones((stroke, stroke), np.float32))[:size, :size].copy())
    return F.avg_pool2d(wide[None], 3, 1, 1, count_include_pad=False)[0] * 0.5 + wide * 0.5


def shape_atlas() -> tuple[Tensor, range, range]:
    """Distance fields of 96 fixed shapes, [1, 1, 8 CELL, 12 CELL], the indices of leaves, and those
    of shapes with holes. Cell 0 is a rectangle."""
    rng, n = np.random.default_rng(20210), 2 * CELL
    y, x = np.meshgrid(*[(np.arange(n) + 0.5) / CELL - 1] * 2, indexing="ij")
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    masks = [
        np.maximum(abs(x), abs(y)) < 0.9,
        (abs(x) ** 6 + abs(y) ** 6) < 0.9**6,
        radius < 0.9,
        abs(x) + abs(y) < 0.9,
    ]
    for _ in range(12):  # leaves: two arcs, widest off the centre, slightly bent, with a serrated edge
        skew, wide, bend, saw = (
            rng.uniform(0.35, 0.65),
            rng.uniform(0.35, 0.75),
            rng.normal(0, 0.15),
            rng.uniform(0, 0.08),
        )
        s = ((x / 0.9 + 1) / 2).clip(1e-6, 1 - 1e-6)
        profile = np.sin(np.pi * s ** (np.log(0.5) / np.log(skew))) ** 0.9 * wide * (1 + saw * np.sin(40 * s))
        masks.append((abs(y - bend * (1 - x**2)) < profile) & (abs(x) < 0.9))
    while len(masks) < 96:
        kind = len(masks) % 4
        if kind == 0:  # polygon around the centre, convex or a star
            corners = rng.integers(3, 10)
            turn = (
                np.sort(rng.uniform(0, 2 * np.pi, corners)) if corners > 5 else np.arange(corners) * 2 * np.pi / corners
            )
            far = rng.uniform(0.45, 0.9, corners)
            px, py = far * np.cos(turn), far * np.sin(turn)
            inside = np.zeros((n, n), bool)
            for i in range(corners):  # even-odd rule
                ax, ay, bx, by = px[i - 1], py[i - 1], px[i], py[i]
                inside ^= ((ay > y) != (by > y)) & (x < (bx - ax) * (y - ay) / (by - ay + 1e-12) + ax)
            masks.append(inside)
        elif kind == 1:  # wavy outline
            wave = sum(rng.normal(0, 0.35 / k) * np.cos(k * angle + rng.uniform(0, 6.3)) for k in range(1, 9))
            masks.append(radius < 0.88 * np.exp(wave - wave.max()))
        elif kind == 2:  # thresholded noise, with holes and islands
            field = noise(rng, n, int(rng.integers(3, 8))).numpy()
            masks.append((field + rng.uniform(0, 1) - 3 * np.maximum(radius - 0.6, 0) > 0) & (radius < 0.92))
        else:  # rings, crosses, frames
            wave = rng.uniform(0.25, 0.6)
            cross = np.minimum(abs(x), abs(y)) < wave * 0.4
            frame = np.maximum(abs(x), abs(y)) > wave
            box = np.maximum(abs(x), abs(y)) < 0.9
            masks.append([(radius < 0.9) & (radius > wave), box & cross, box & frame][rng.integers(3)])
    inside = torch.from_numpy(np.stack(masks))
    field = _distance(~inside) - _distance(inside)
    field = F.avg_pool2d(F.avg_pool2d(field[:, None], 3, 1, 1, count_include_pad=False), 2) / CELL
    atlas = field.reshape(-1, COLUMNS, CELL, CELL).transpose(1, 2).reshape(1, 1, -1, COLUMNS * CELL)
    return atlas.contiguous(), range(4, 16), range(18, 96, 4)


def _distance(mask: Tensor) -> Tensor:
    """Distance in texels to the nearest true texel of each [N, n, n] mask, columns
    first, then rows."""
    n = mask.shape[-1]
    gap = (torch.arange(n)[:, None] - torch.arange(n)).float() ** 2
    squared = torch.where(mask, 0.0, 4.0 * n * n)
    fields = []
    for field in squared:
        field = torch.stack([(field + gap[i][:, None]).amin(0) for i in range(n)])
        fields.append(torch.stack([(field + gap[i][None]).amin(1) for i in range(n)], 1))
    return torch.stack(fields).sqrt()
