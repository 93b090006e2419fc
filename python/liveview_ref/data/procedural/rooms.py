"""Rooms: a box of walls, floor and ceiling around the cameras, mostly without texture, with
furniture along its axes."""

from dataclasses import dataclass

import numpy as np

from .furniture import FURNITURE, plain_look, softness
from .surfaces import Pane, draw_panes, everything, look
from .textures import Textures
from .world import Fragments, World

GRID = 9  # pixels per side of the crop at which the depth of the walls is sampled
TRIES = 20


@dataclass
class Room:
    """axes [3, 3]: rows right, down, forwards in the target's frame; distances [6] of the walls:
    along the axes, then against them."""

    axes: np.ndarray
    distances: np.ndarray

    @property
    def normals(self) -> np.ndarray:
        """Unit normals [6, 3] that point out of the room."""
        return np.concatenate([self.axes, -self.axes])

    def depth(self, rays: np.ndarray) -> np.ndarray:
        """Depth of the walls along rays [3, K] of depth 1."""
        along = self.normals @ rays
        return np.where(along > 1e-6, self.distances[:, None] / np.maximum(along, 1e-6), np.inf).min(0)


def draw_room(rng: np.random.Generator, world: World, textures: Textures, things: tuple[int, int]) -> list[Fragments]:
    """The walls, and pieces of furniture (`things`: least, and one more than most)."""
    room = fitted(rng, world)
    fragments = []
    for wall in range(6):
        fragments += draw_wall(rng, world, textures, room, wall)
    names, shares = list(FURNITURE), np.array([share for _, share in FURNITURE.values()])
    for _ in range(rng.integers(*things)):
        pixel = rng.uniform(-0.1, 1.1, 2) * world.size[::-1]
        ray = world.rays_of[0] @ [*pixel, 1]
        depth = float(room.depth(ray[:, None])[0]) * rng.uniform(0.3, 0.97)
        disparity = 1 / max(depth, 1.02)
        draw, _ = FURNITURE[rng.choice(names, p=shares / shares.sum())]
        fragments += draw(rng, world, textures, room.axes, *pixel, disparity)
    return fragments


def fitted(rng: np.random.Generator, world: World) -> Room:
    """A room whose walls lie within the world's depths in the target, if one is found."""
    height, width = world.size
    x, y = np.meshgrid(np.linspace(0, width, GRID), np.linspace(0, height, GRID))
    rays = world.rays_of[0] @ np.stack([x.ravel(), y.ravel(), np.ones(GRID**2)])
    for _ in range(TRIES):
        yaw, pitch, roll = np.radians([rng.uniform(-50, 50), rng.normal(8, 12), rng.normal(0, 3)])
        axes = turn(roll, 2) @ turn(pitch, 0) @ turn(yaw, 1)
        left, right = np.exp(rng.uniform(np.log(0.8), np.log(4), 2))
        front, behind = np.exp(rng.uniform(np.log(2), np.log(6))), 3.0
        distances = np.array([right, rng.uniform(0.5, 1.6), front, left, rng.uniform(0.6, 1.8), behind])
        room = Room(axes, distances)
        depth = room.depth(rays)
        scale = 0.97 / world.farthest / depth.max()
        if scale * depth.min() > 1.02:
            room.distances = distances * scale
            return room
    room.distances = distances * 1.02 / depth.min()
    return room


def turn(angle: float, axis: int) -> np.ndarray:
    """Rotation about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    r = np.eye(3)
    r[i, i], r[i, j], r[j, i], r[j, j] = c, -s, s, c
    return r


def draw_wall(rng, world: World, textures: Textures, room: Room, wall: int) -> list[Fragments]:
    normal, distance = room.normals[wall], room.distances[wall]
    height, width = world.size
    ray = world.rays_of[0] @ [width / 2, height / 2, 1]
    along = normal @ ray
    centre = ray * distance / along if along > 0.05 else normal * distance
    disparity = float(np.clip(1 / max(centre[2], 1e-6), world.farthest, 1))
    others = [room.axes[(wall % 3 + i) % 3] for i in (1, 2)]
    p = Pane(centre, normal / distance, *others, (np.inf, np.inf), disparity, softness(world, normal / distance))
    plain = rng.random() < (0.35 if wall == 1 else 0.65)  # floors have more texture
    style = (plain_look if plain else look)(rng, world, textures, world.extent, 1, centre, normal)
    drawn = draw_panes(world, [p], style, everything, True)
    for fragments in drawn:
        fragments.order = 1e-6 * wall
    return drawn
