"""Curved surfaces of procedural scenes: ellipsoids, cylinders, wires, wavy sheets."""

import numpy as np
import torch
from torch import Tensor

from .surfaces import Pane, cross, length, look, paint, shape_cut, shine, slab
from .textures import Textures
from .world import Fragments, World


def round_body(
    rng, world: World, textures: Textures, x, y, disparity, radius_pixels, kind: str, upright: np.ndarray | None = None
) -> list[Fragments]:
    """An ellipsoid, or a cylinder or wire (kind 'cylinder') through target pixel (x, y), with the
    axis `upright`, if given."""
    pixel = 1 / (disparity * world.focal[0])
    radius, centre = radius_pixels * pixel, world.point(x, y, disparity)
    facing = -centre / np.linalg.norm(centre)
    if upright is None:
        axis = rng.normal(0, 1, 3) * [1, 1, 0.5]
        axis -= facing * (facing @ axis) * rng.choice([1, 0.6])
        axis /= np.linalg.norm(axis)
    else:
        axis = upright
    forward = facing - axis * (facing @ axis)
    forward /= np.linalg.norm(forward)
    frame = np.stack([cross(axis, forward), axis, forward])  # local x, y (the axis), z (towards the cameras)
    long = kind == "cylinder"
    if long:
        half = min(rng.uniform(20, 160), 0.6 / max(disparity, 1e-3) / pixel) * pixel
        slope = abs(axis[2]) * half * disparity
        half /= max(1, slope / max(min(1.15 - disparity, disparity - world.farthest * 0.7), 0.02) * disparity)
        spans = np.array([[i, j * half / radius, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * radius
        scale = np.full(3, radius)
    else:
        scale = radius * np.array([1, rng.uniform(0.6, 1.4), rng.uniform(0.5, 1)])
        spans = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * scale
    pixels, rows, _ = world.pixels(world.boxes((spans @ frame + centre)[None]))
    if len(rows) == 0:
        return []
    to_local = torch.from_numpy(frame / scale[:, None]).float()  # the body becomes a unit sphere or cylinder
    rays_world = world.rays.index_select(1, pixels)
    rays = to_local @ rays_world
    starts = np.ascontiguousarray((frame / scale[:, None]) @ (world.origins - centre).T)
    start = torch.from_numpy(starts).float().index_select(1, rows)
    a, towards, miss = approach(rays, start, long)
    blur = 1 / float(world.focal.min())
    near = ((miss - 1) * radius < -towards / a * blur).nonzero()[:, 0]
    if len(near) == 0:
        return []
    if len(near) < 0.8 * len(rows):  # most of the box of a slanted wire is empty
        pixels, rows, a, towards, miss = (part[near] for part in (pixels, rows, a, towards, miss))
        rays_world, rays, start = (part.index_select(1, near) for part in (rays_world, rays, start))
    depth = ((-towards - (a * (1 - miss**2)).clamp(min=0).sqrt()) / a).clamp(min=0.02)
    point = start + depth * rays
    inverse_focal = torch.from_numpy(1 / world.focal).float()[rows]
    size = depth * inverse_focal
    alpha = slab(miss * radius, radius, size) * (depth > 0.02)
    if long:
        normal = torch.stack([point[0], torch.zeros_like(miss), point[2]])
        u, v, stretch = torch.atan2(point[0], point[2]) * radius, point[1] * radius, 1.0
        alpha = alpha * slab(v, half, size)
    else:
        normal = point
        stretch = 2 / (1 + point[2]).clamp(min=0.3)  # stereographic
        u, v = point[0] * stretch * radius, point[1] * stretch * radius
    normal = to_local.T @ normal
    normal = normal / length(normal).clamp(min=1e-9)
    along = (normal * rays_world).sum(0)
    slant = (length(rays_world) / (-along).clamp(min=1e-6)).clamp(1, 6)
    style = look(rng, world, textures, 3 * radius_pixels, 1, centre, facing)
    if radius_pixels < 2:  # wires are nearly of one colour
        style.atlas = torch.lerp(style.atlas[..., :1, :1], style.atlas, 0.3)
    texel = pixel / style.density
    light = facing + rng.normal(0, 0.7, 3)
    light = torch.from_numpy(light / np.linalg.norm(light)).float()
    shade = rng.uniform(0.3, 0.9)
    tint = torch.lerp(torch.ones(()), (light @ normal).clamp(min=0) * 1.2, 1 - shade)
    colour = paint(
        world,
        style,
        style.shift[0, 0] + u / texel,
        style.shift[0, 1] + v / texel,
        size * slant**0.75 * stretch,
        texel,
        tint,
    )
    if style.gloss is not None:
        strength, power, direction = style.gloss
        style.gloss = (strength, power / 12, direction)
    colour = shine(style, colour, rays_world, normal, along)
    return [Fragments(disparity, pixels, colour, alpha, 1 / depth, disparity**2 * size.mean().item())]


def approach(rays: Tensor, start: Tensor, long: bool) -> tuple[Tensor, Tensor, Tensor]:
    """For rays [3, K] from `start`: a = |ray|^2, ray . start, and their distance from the centre
    (or the y axis)."""
    if long:
        a = rays[0] ** 2 + rays[2] ** 2
        miss = (start[0] * rays[2] - start[2] * rays[0]).abs() / a.sqrt()
        return a, rays[0] * start[0] + rays[2] * start[2], miss
    a = (rays**2).sum(0)
    return a, (rays * start).sum(0), length(torch.linalg.cross(rays, start, dim=0)) / a.sqrt()


def wavy(rng, world: World, textures: Textures, p: Pane, whole: bool) -> list[Fragments]:
    """A pane with smooth waves added to its disparity in the target, intersected by fixed-point
    iteration and painted by projection from the target. The waves are low enough that it never
    occludes itself and the iteration converges."""
    number, pixel = 2, 1 / (p.disparity * world.focal[0])
    wave = np.exp(rng.uniform(np.log(50), np.log(220), number))
    # in total |gradient| * reach * focal < 0.35
    height = 0.35 / number * wave / (2 * np.pi * max(world.reach, 1e-3) * world.focal[0])
    height = np.minimum(height, max(0.25 * min(1.2 - p.disparity, p.disparity - 0.7 * world.farthest), 0.0))
    angle, phase = rng.uniform(0, 2 * np.pi, (2, number))
    fx, fy = np.cos(angle) * 2 * np.pi / wave, np.sin(angle) * 2 * np.pi / wave
    boxes = None
    if not whole:
        corners = [p.centre + p.a * p.half[0] * i * 1.1 + p.b * p.half[1] * j * 1.1 for i in (-1, 1) for j in (-1, 1)]
        corners = [
            c * s for c in corners for s in (1 / (1 + height.sum() / p.disparity), 1 / (1 - height.sum() / p.disparity))
        ]
        boxes = world.boxes(np.stack(corners)[None])
    pixels, rows, _ = world.pixels(boxes)
    if len(rows) == 0:
        return []
    rays = world.rays if pixels is None else world.rays.index_select(1, pixels)
    normal = torch.from_numpy(p.normal).float()
    start = (
        torch.from_numpy(np.concatenate([world.origins.T, [1 - world.origins @ p.normal]]))
        .float()
        .index_select(1, rows)
    )
    n_ray = normal @ rays
    f, cx, cy = world.focal[0], world.k[0, 0, 2], world.k[0, 1, 2]
    bump = torch.zeros_like(n_ray)
    for step in range(4):
        disparity = ((n_ray + rays[2] * bump) / (start[3] - start[2] * bump)).clamp(min=world.farthest * 0.2)
        point = start[:3] + rays / disparity
        x, y = point[0] / point[2] * f + cx, point[1] / point[2] * f + cy
        if step < 3:
            waves = np.stack([height, fx, fy, phase], 1).tolist()
            bump = sum(h * torch.sin(x * i + y * j + k) for h, i, j, k in waves)
    style = look(rng, world, textures, world.extent if whole else 2 * max(p.half) / pixel)
    inverse_focal = torch.from_numpy(1 / world.focal).float()[rows]
    size = inverse_focal / disparity
    footprint = size * f / point[2]
    alpha = torch.ones_like(size)
    if not whole:
        flat = point / (point * normal[:, None]).sum(0) - torch.from_numpy(p.centre).float()[:, None]
        u, v = (torch.from_numpy(axis).float() @ flat for axis in (p.a, p.b))
        alpha = shape_cut(textures, [p], rng.integers(0, 96, 1))(u, v, size, None)
    tint = torch.from_numpy(style.tint[0]).float()[:, None]
    middle = world.k[0] @ (p.centre / p.centre[2])
    u, v = (
        (at - float(c)) * style.density + float(o) for at, c, o in zip((x, y), middle, style.shift[0], strict=False)
    )
    colour = paint(world, style, u, v, footprint, 1 / style.density, tint)
    soft = p.soft + float((height * 2 * np.pi / wave).sum()) * 0.5
    return [Fragments(p.disparity, pixels, colour.clamp(0, 1), alpha, disparity, max(soft, 1e-6))]
