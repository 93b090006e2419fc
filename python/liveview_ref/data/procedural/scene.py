"""Procedural training scenes: a handful of textured surfaces at all depths, seen by a target camera
and V views.

Everything is computed in the target camera's frame, in which the nearest depth is 1; at the end a
random rigid motion and a random unit of length are applied. Every surface is intersected
analytically with the rays of all cameras at once, which gives fragments (pixels, colour, alpha,
disparity); these are composited far to near, with a depth test. Camera 0 is the target. The pixels
of all cameras form one flat list.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ...reference.liveview import Camera
from .contents import draw_background, draw_objects
from .photographs import imperfections, phone
from .rooms import draw_room
from .textures import Textures
from .world import Fragments, World

LARGEST_VIEW = 224  # pixels


@dataclass
class ProceduralScene:
    """One multi-view example: views V of [3, Hs, Ws] and target [3, H, W], float32 RGB in [0, 1],
    and their cameras; disparity [H, W] = 1/z at pixel centres of the surface with the largest
    compositing weight, view_disparities the same for each view in its own camera; [near, far]
    contains all depths visible in the target."""

    views: list[Tensor]
    cameras: list[Camera]
    target: Tensor
    target_camera: Camera
    near: float
    far: float
    disparity: Tensor | None
    view_disparities: list[Tensor]


@dataclass(frozen=True)
class Recipe:
    """Distributions: the parallax of the farthest view between the nearest and the farthest depth,
    log-uniform between two numbers of pixels (None: mostly 10 to 50); probabilities of no, slight
    and strong differences of exposure; number of things in front of the background (least, and one
    more than most); factor of the frequency of thin structures; shares of the scenes that are
    rooms, and that a phone took."""

    parallax: tuple[float, float] | None = None
    exposure: tuple[float, float, float] = (0.2, 0.75, 0.05)
    things: tuple[int, int] = (2, 9)
    thin: float = 1.0
    rooms: float = 0.0
    phones: float = 0.0


def random_scene(
    rng: np.random.Generator, n_views: int, size: tuple[int, int], textures: Textures, recipe: Recipe = Recipe()
) -> ProceduralScene:
    """Draw a scene and a rig from `rng`; the target is `size` = (H, W) pixels."""
    world = make_world(rng, n_views, size, recipe)
    images, disparities = render(rng, world, textures, recipe)
    by_phone = recipe.phones > 0 and rng.random() < recipe.phones
    views = phone(rng, images[1:], disparities[1:]) if by_phone else imperfections(rng, images[1:], recipe.exposure)
    disparity = disparities[0]
    low, high = float(disparity.min()), float(disparity.max())
    if rng.random() < 0.5:  # the bounds of a whole photo are wider than those of a crop
        low, high = min(low, world.farthest), max(high, 1.0)
    unit = float(np.exp(rng.uniform(-2, 2)))
    turn, shift = rotation(rng.normal(0, 1, 3)), rng.normal(0, 3, 3)  # target_from_world
    poses = (torch.from_numpy(x) for x in (world.k, world.r @ turn, (world.r @ shift + world.t) * unit))
    photos = [images[0].contiguous(), *views]
    camera, *cameras = (Camera(*pose, x.shape[2], x.shape[1]) for *pose, x in zip(*poses, photos, strict=True))
    near, far = unit / (high * 1.01), unit / (low * 0.99)
    disparity, *others = (d / unit for d in disparities)
    return ProceduralScene(views, cameras, photos[0], camera, near, far, disparity, others)


def render(
    rng: np.random.Generator, world: World, textures: Textures, recipe: Recipe = Recipe()
) -> tuple[list[Tensor], list[Tensor]]:
    """Fill the world and render it: images [3, H, W] and disparities [H, W] of all cameras, the
    target first."""
    if recipe.rooms > 0 and rng.random() < recipe.rooms:
        fragments = draw_room(rng, world, textures, recipe.things)
    else:
        fragments = draw_background(rng, world, textures)
        fragments += draw_objects(rng, world, textures, recipe.things, recipe.thin)
    colour, disparity = composite(world, fragments)
    images, disparities = [], []
    for c, (height, width) in enumerate(world.sizes):
        span = slice(world.base[c], world.base[c + 1])
        images.append(colour[:, span].reshape(3, height, width))
        disparities.append(disparity[span].reshape(height, width))
    return images, disparities


def make_world(rng: np.random.Generator, n_views: int, size: tuple[int, int], recipe: Recipe = Recipe()) -> World:
    """Cameras: the target is a crop of a photo's frustum; the views around it are large enough to
    cover what the target sees."""
    height, width = size
    photo = rng.uniform(350, 600)
    focal = photo / 2 / np.tan(np.radians(rng.uniform(50, 75)) / 2)
    tall = max(photo * rng.uniform(0.56, 0.8), height + 1)
    left, top = rng.uniform(0, max(1, photo - width)), rng.uniform(0, tall - height)
    k = np.array([[[focal, 0, photo / 2 - left], [0, focal, tall / 2 - top], [0, 0, 1]]])
    ratio = np.exp(rng.uniform(np.log(1.5), np.log(30)))
    farthest = 1 / ratio
    logs = np.log([4, 22, 100])
    if recipe.parallax:
        spread = np.exp(rng.uniform(*np.log(recipe.parallax)))
    else:
        spread = np.exp(rng.uniform(logs[0], logs[2]) if rng.random() < 0.5 else rng.triangular(*logs))
    baseline = min(spread / (focal * (1 - farthest)), 0.8)
    centres = rig(rng, n_views) * baseline
    centres[:, 2] = centres[:, 2].clip(-0.25, 0.25)

    most = np.radians(rng.choice([0, 1, rng.uniform(1, 8)], p=[0.25, 0.15, 0.6]))
    zoom = rng.normal(0, 0.04, n_views) if rng.random() < 0.3 else np.zeros(n_views)
    cut = rng.random() < 0.15  # borders of views are visible inside the target
    sizes, rs, ts, ks = [size], [np.eye(3)], [np.zeros(3)], [k[0]]
    corners = np.array([[x, y, 1] for x in (0, width) for y in (0, height)]).T
    for v in range(n_views):
        axis = rng.normal(0, 1, 3)
        r = rotation(axis / np.linalg.norm(axis) * rng.uniform(0, most))
        k_view = np.diag([focal * np.exp(zoom[v])] * 2 + [1])
        seen = []
        for disparity in (farthest, 1.0):
            points = r @ (np.linalg.inv(k[0]) @ corners / disparity - centres[v][:, None])
            points = k_view @ (points / np.maximum(points[2], 0.1))
            seen.append(points[:2])
        low = np.concatenate(seen, 1).min(1) - 3
        high = np.concatenate(seen, 1).max(1) + 3
        middle, extent = (low + high) / 2, np.minimum(high - low, LARGEST_VIEW)
        if cut and rng.random() < 0.7:
            middle = middle + rng.uniform(-0.3, 0.3, 2) * extent
            extent = extent * rng.uniform(0.55, 1, 2)
        w, h = (int(e) for e in np.clip(np.ceil(extent), 48, LARGEST_VIEW))
        k_view[:2, 2] = np.array([w, h]) / 2 - middle
        sizes.append((h, w))
        ks.append(k_view), rs.append(r), ts.append(-r @ centres[v])
    return World(
        np.stack(ks), np.stack(rs), np.stack(ts), sizes, farthest, float(np.linalg.norm(centres, axis=1).max())
    )


def rig(rng: np.random.Generator, count: int) -> np.ndarray:
    """Camera centres [count, 3] about the target at the origin, the farthest at distance 1."""
    kind = rng.choice(6, p=[0.35, 0.15, 0.2, 0.1, 0.1, 0.1])
    i = np.arange(count)
    points = np.zeros((count, 3))
    if kind == 0:  # hand-held cloud
        points = rng.normal(0, 1, (count, 3)) * [1, rng.uniform(0.3, 1), rng.uniform(0, 0.5)]
    elif kind == 1:  # line
        points[:, 0] = i + rng.normal(0, 0.12, count)
    elif kind == 2:  # grid
        side = int(np.ceil(count**0.5))
        points[:, :2] = np.stack([i % side, i // side], 1) * [1, rng.uniform(0.5, 1.2)]
        points[:, :2] += rng.normal(0, rng.choice([0, 0.12]), (count, 2))
    elif kind == 3:  # stereo: two groups of close cameras
        points[:, 0] = i % 2
        points += rng.normal(0, 0.1, (count, 3)) * (i >= 2)[:, None]
    elif kind == 4:  # spiral
        points[:, 0], points[:, 1] = np.sqrt(i + 0.5) * np.cos(2.4 * i), np.sqrt(i + 0.5) * np.sin(2.4 * i)
        points[:, 2] = 0.15 * np.cos(1.3 * i)
    else:  # walk, partly forwards
        points[:, 0], points[:, 2] = i, i * rng.uniform(0.3, 2)
        points += rng.normal(0, 0.08, (count, 3))
    if kind in (0, 1, 2, 3, 5):
        angle = rng.choice([0, np.pi / 2, rng.uniform(0, np.pi)], p=[0.4, 0.2, 0.4])
        c, s = np.cos(angle), np.sin(angle)
        points[:, :2] = points[:, :2] @ np.array([[c, s], [-s, c]])
    points += rng.normal(0, 0.02, (count, 3)) * (rng.random() < 0.6)
    place = rng.random()
    if place < 0.8:  # inside the hull
        target = rng.dirichlet(np.full(count, 1.5)) @ points
        target = target + rng.normal(0, 0.05, 3) * [1, 1, 0.5] * np.ptp(points, axis=0).max()
    elif place < 0.9:  # nearly on a view
        target = points[rng.integers(count)] + rng.normal(0, 0.03, 3) * np.ptp(points, axis=0).max()
    else:  # beyond the hull
        target = points.mean(0) + (points[rng.integers(count)] - points.mean(0)) * rng.uniform(1.1, 1.5)
    points = points - target
    return points / max(np.linalg.norm(points, axis=1).max(), 1e-6)


def rotation(vector: np.ndarray) -> np.ndarray:
    """Rotation matrix [3, 3] of an axis times angle."""
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def composite(world: World, fragments: list[Fragments]) -> tuple[Tensor, Tensor]:
    """Composite far to near: colour [3, N] and the disparity [N] (1/z) of the surface with the
    largest weight."""
    n = world.base[-1]
    colour, disparity, weight = torch.zeros(3, n), torch.zeros(n), torch.zeros(n)
    for f in sorted(fragments, key=lambda f: f.order):
        everywhere = f.pixels is None
        old = disparity if everywhere else disparity.index_select(0, f.pixels)
        alpha = f.alpha * ((f.disparity - old) * (1 / f.soft) + 0.5).clamp(0, 1)
        behind = (weight if everywhere else weight.index_select(0, f.pixels)) * (1 - alpha)
        front = alpha > behind
        if everywhere:
            colour.lerp_(f.colour, alpha)
            disparity, weight = torch.where(front, f.disparity, old), torch.maximum(alpha, behind)
        else:
            colour.index_copy_(1, f.pixels, torch.lerp(colour.index_select(1, f.pixels), f.colour, alpha))
            disparity.index_copy_(0, f.pixels, torch.where(front, f.disparity, old))
            weight.index_copy_(0, f.pixels, torch.maximum(alpha, behind))
    return colour, disparity
