"""The contents of a procedural scene: a complete background, and things in front of it."""

import numpy as np
import torch

from .bodies import round_body, wavy
from .surfaces import Pane, cross, draw_panes, everything, grating_cut, look, pane, shape_cut
from .textures import Textures
from .world import Fragments, World

KINDS = {  # kinds of things, and their frequencies
    "shape": 0.32,
    "ball": 0.11,
    "cylinder": 0.08,
    "wire": 0.08,
    "grating": 0.1,
    "leaves": 0.14,
    "wavy": 0.1,
    "occluder": 0.07,
}
THIN = "wire", "grating", "leaves"  # kinds


def draw_background(rng: np.random.Generator, world: World, textures: Textures) -> list[Fragments]:
    """A background that covers all pixels: a plane (flat, tilted or wavy), in half of the scenes
    with a floor and walls that come nearer."""
    h, w = world.size
    span = 1 - world.farthest
    room = rng.random() < 0.4
    low = world.farthest * (1 if room or rng.random() < 0.5 else rng.uniform(1, 1 + 0.4 * span / world.farthest))
    low = min(max(low, world.farthest * 1.02), 0.9)
    p = pane(rng, world, w / 2, h / 2, low, np.radians(rng.choice([0, rng.uniform(0, 75)])), [world.extent] * 2, False)
    if rng.random() < 0.25:
        fragments = wavy(rng, world, textures, p, True)
    else:
        style = look(rng, world, textures, world.extent, 1, p.centre, p.normal)
        fragments = draw_panes(world, [p], style, everything, True)
    fragments[0].order = 0.0
    fragments[0].alpha = torch.ones_like(fragments[0].alpha)
    for side in rng.permutation(4)[: rng.integers(1, 3)] if room else []:
        # disparity in the target grows linearly towards one border: floor, ceiling or wall
        start, rise = rng.uniform(0.1, 0.7), rng.uniform(0.15, 0.9) * span
        across, out = (h, np.array([0, 1.0])) if side < 2 else (w, np.array([1.0, 0]))
        if side % 2:
            out = -out
        edge = np.array([w, h]) * (0.5 + out * (start - 0.5))
        slope = rise / ((1 - start) * across) * out + rng.normal(0, 0.1 * rise / across, 2)
        flat = np.array([slope[0], slope[1], world.farthest - slope @ edge])  # disparity = flat . (x, y, 1)
        normal = world.k[0].T @ flat
        middle = edge + out * across * (1 - start) / 2
        disparity = float(flat @ [*middle, 1])
        if disparity <= world.farthest:
            continue
        centre, unit = world.point(*middle, disparity), normal / np.linalg.norm(normal)
        a = cross(unit, [0.3, 0.2, 1.0])
        a /= np.linalg.norm(a)
        wall = Pane(centre, normal, a, cross(unit, a), (np.inf, np.inf), disparity, float(np.linalg.norm(slope)))
        style = look(rng, world, textures, world.extent, 1, centre, normal)
        drawn = draw_panes(world, [wall], style, everything, True)
        drawn[0].order = 1e-6
        fragments += drawn
    return fragments


def draw_objects(
    rng: np.random.Generator,
    world: World,
    textures: Textures,
    number: tuple[int, int] = (2, 9),
    thin: float = 1.0,
) -> list[Fragments]:
    """Things (`number`: least, and one more than most), at disparities between the farthest and 1;
    the first near 1. Thin kinds are `thin` times as frequent."""
    h, w = world.size
    chances = np.array([share * (thin if kind in THIN else 1) for kind, share in KINDS.items()])
    chances = chances / chances.sum()
    crop, fragments = max(h, w), []
    for i in range(rng.integers(*number)):
        share = rng.uniform(0.8, 1) if i == 0 else rng.uniform(0.02, 0.95) ** 1.3
        disparity = world.farthest + (1 - world.farthest) * share
        x, y = rng.uniform(-0.15, 1.15, 2) * [w, h]
        kind = rng.choice(list(KINDS), p=chances)
        tilt = np.radians(rng.choice([0, rng.uniform(0, 65)], p=[0.3, 0.7]))
        size = crop * np.exp(rng.uniform(np.log(0.08), np.log(0.45)))
        if kind == "ball":
            fragments += round_body(rng, world, textures, x, y, disparity, size * 0.7, "ball")
        elif kind == "cylinder":
            fragments += round_body(rng, world, textures, x, y, disparity, size * 0.4, "cylinder")
        elif kind == "wire":
            for _ in range(rng.integers(1, 5)):
                x, y = rng.uniform(0, 1, 2) * [w, h]
                radius = np.exp(rng.uniform(np.log(0.35), np.log(1.8)))
                fragments += round_body(rng, world, textures, x, y, disparity * rng.uniform(0.9, 1), radius, "cylinder")
        elif kind == "leaves":
            fragments += leaves(rng, world, textures, x, y, disparity)
        else:
            if kind == "occluder":
                x, y = (rng.choice([-0.1, 1.1]) * w, y) if rng.random() < 0.5 else (x, rng.choice([-0.1, 1.1]) * h)
                size = crop * rng.uniform(0.3, 0.6)
            if kind == "grating":
                size *= 2
            half = [size * np.exp(rng.normal(0, 0.3)), size * np.exp(rng.normal(0, 0.3))]
            p = pane(rng, world, x, y, disparity, tilt, half)
            if kind == "wavy":
                fragments += wavy(rng, world, textures, p, False)
                continue
            style = look(rng, world, textures, 2 * max(half), 1, p.centre, p.normal)
            if kind == "grating":
                cut = grating_cut(rng, world, p)
            else:
                cut = shape_cut(textures, [p], np.array([0 if rng.random() < 0.25 else rng.integers(96)]))
            fragments += draw_panes(world, [p], style, cut)
    return fragments


def leaves(rng: np.random.Generator, world: World, textures: Textures, x, y, disparity) -> list[Fragments]:
    """Foliage about (x, y) over a range of depths: many small leaves of one texture, or a few
    sheets with many holes."""
    crop = max(world.size)
    depth_range = rng.uniform(0.05, 0.5) * (disparity - world.farthest)
    sheets = rng.random() < 0.3
    if sheets:
        count, spread, size = int(rng.integers(2, 5)), 0.15 * crop, crop * rng.uniform(0.2, 0.5)
        cells, slender = np.array(textures.thickets), 1.0
    else:
        count, spread = int(rng.integers(15, 70)), crop * rng.uniform(0.12, 0.4)
        size = crop * np.exp(rng.uniform(np.log(0.035), np.log(0.14)))
        cells, slender = rng.choice(np.array(textures.leaves), 3), rng.uniform(0.3, 1)
    panes = []
    for _ in range(count):
        at = disparity - depth_range * rng.random()
        half = size * np.exp(rng.normal(0, 0.25)) * at / disparity
        px, py = x + rng.normal(0, spread), y + rng.normal(0, spread)
        panes.append(pane(rng, world, px, py, at, np.radians(rng.uniform(0, 65)), (half, half * slender)))
    style = look(rng, world, textures, 3 * size, count)
    return draw_panes(world, panes, style, shape_cut(textures, panes, rng.choice(cells, count)))
