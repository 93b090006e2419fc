"""The moving scene in front of the rig: `yard`, then `hall` after a hard cut.
python/tools/make_rig_clip.py renders it.

World axes are OpenCV's (x right, y down, z forward); a length of 1 is about a metre. The textures
are the workshop's.
"""

import runpy
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from liveview_ref.data.image import to_u8

WORKSHOP = runpy.run_path(str(Path(__file__).parents[1] / "workshop" / "scene.py"))
NEAR, FAR = 1.2, 7.2  # depth range of both sets from all cameras
FLOOR = 1.3
COLOURS = {"white": "e9e4d6", "iron": "33363c", "red": "c8352a", "amber": "eda02c", "blue": "2a5f9e", "leaf": "5d9445"}
COLOURS |= {"rust": "b0512f", "night": "2b3a55", "rope": "c4a878", "cream": "e6d2a4"}

# Largest texture side in pixels where it is not 1024: finer detail would enlarge the JPEG files.
MAX_SIDE = {"wall": 128, "walnut": 128, "teal": 128, "oak": 256, "glaze": 256, "tile": 512}


class Shape(NamedTuple):
    """A box, a ball or a rod (a cylinder along its local y axis).

    at: world-from-local transform [4, 4]; the shape is centred on the local origin. half: half of
    its size along each local axis, for round shapes the radius. tile: size of one copy of the
    texture in world units (for round shapes in turns and heights), or None for one copy on each
    side. gloss: strength of the highlight.
    """

    kind: str
    texture: str
    at: np.ndarray
    half: tuple
    tile: tuple | None = None
    gloss: float = 0.0


def textures():
    """Maps names to 8-bit sRGB textures whose sides are powers of two."""
    out = {name: np.uint8([[[int(c[i : i + 2], 16) for i in (0, 2, 4)]]]) for name, c in COLOURS.items()}
    for name, image in WORKSHOP["textures"](np.random.default_rng(7)).items():
        max_side = MAX_SIDE.get(name, 1024)
        side = [2 ** round(np.log2(min(n, max_side))) for n in image.shape[1::-1]]
        out[name] = np.asarray(Image.fromarray(to_u8(image)).resize(side))
    return out


def place(x=0.0, y=0.0, z=0.0, yaw=0.0, roll=0.0, pitch=0.0):
    """The world-from-local transform that rotates by pitch about x, then by roll about z, then by
    yaw about y (in degrees), and then moves the origin to (x, y, z)."""
    out = np.eye(4)
    for axis, angle in ((1, yaw), (2, roll), (0, pitch)):
        k = np.cross(np.eye(3), np.eye(3)[axis])
        a = np.radians(angle)
        out[:3, :3] @= np.eye(3) + np.sin(a) * k + (1 - np.cos(a)) * k @ k
    out[:3, 3] = x, y, z
    return out


def box(texture, at, size, tile=None):
    return Shape("box", texture, at, tuple(side / 2 for side in size), tile)


def ball(texture, at, radius, gloss=0.5):
    return Shape("ball", texture, at, (radius,) * 3, None, gloss)


def rod(texture, at, radius, length, tile=None, gloss=0.0):
    return Shape("rod", texture, at, (radius, length / 2, radius), tile, gloss)


def swing(period, degrees, t):
    return degrees * np.sin(2 * np.pi * t / period)


def bounce(period, height, t):
    s = t / period % 1
    return height * 4 * s * (1 - s)


def yard(t, since):
    """The shapes of the first set at t seconds. since: seconds since the cart entered from the
    right, negative before that."""
    out = [
        box("tile", place(0, FLOOR + 0.1, 4), (16, 0.2, 12), (7, 7)),
        box("wall", place(0, -1.2, 7.1), (16, 5, 0.4), (12, 5)),
        box("poster", place(-1.0, -0.45, 6.87), (1.35, 1.8, 0.04)),
        box("white", place(0, FLOOR - 0.08, 6.87), (16, 0.16, 0.06)),
    ]
    # A fence and a lamp pole.
    fence = place(-1.62, FLOOR, 2.75, yaw=-24)
    for k, x in enumerate(np.linspace(-0.75, 0.75, 9).tolist()):
        h = 0.9 + 0.05 * (k % 2)
        out.append(box("white", fence @ place(x, -h / 2, -0.03), (0.075, h, 0.02)))
        out.append(box("white", fence @ place(x, -h, -0.03, roll=45), (0.053, 0.053, 0.02)))
    out += [box("cream", fence @ place(0, -h, 0), (1.7, 0.06, 0.03)) for h in (0.25, 0.72)]
    lamp = (0.4, FLOOR, 1.35)
    out += [rod("iron", place(lamp[0], FLOOR - 0.75, lamp[2]), 0.012, 1.5)]
    out += [ball("amber", place(lamp[0], FLOOR - 1.52, lamp[2]), 0.07)]
    # A crate turning on a post, a swing, a bouncing ball.
    out.append(rod("walnut", place(1.3, FLOOR - 0.3, 4.3), 0.3, 0.6, (1, 1)))
    out.append(box("oak", place(1.3, FLOOR - 0.96, 4.3, yaw=20 + 110 * t), (0.55, 0.55, 0.55)))
    out.append(ball("glaze", place(1.3, FLOOR - 1.42, 4.3, yaw=20 + 110 * t), 0.18))
    for x in (-0.95, 0.75):
        out.append(rod("rust", place(x, FLOOR - 1.1, 5.3), 0.05, 2.2))
    out.append(rod("rust", place(-0.1, FLOOR - 2.2, 5.3, roll=90), 0.05, 1.9))
    seat = place(-0.1, FLOOR - 2.2, 5.3, pitch=swing(1.8, 32, t + 0.2))
    out.append(box("red", seat @ place(0, 1.6, 0), (0.75, 0.05, 0.3)))
    out += [rod("rope", seat @ place(x, 0.8, 0), 0.014, 1.6) for x in (-0.33, 0.33)]
    out.append(ball("blue", seat @ place(0, 1.4, 0), 0.17))
    height = bounce(0.8, 0.75, t + 0.1)
    out.append(
        ball("glaze", place(-0.42 + 0.2 * np.sin(1.9 * t), FLOOR - 0.2 - height, 2.35, yaw=80 * t, roll=120 * t), 0.2)
    )
    out.append(box("leaf", place(-0.47, FLOOR - 0.2, 1.75, yaw=swing(1.4, 25, t)), (0.3, 0.4, 0.22)))
    # The cart: visible for half of its 4.5 seconds.
    if since >= 0:
        cart = place(1.8 - 1.6 * np.sin(1.4 * since), FLOOR, 2.9)
        out.append(box("teal", cart @ place(0, -0.36, 0), (0.8, 0.34, 0.4)))
        out.append(box("red", cart @ place(0.2, -0.68, 0), (0.34, 0.3, 0.34)))
        out.append(rod("iron", cart @ place(-0.25, -0.66, 0), 0.06, 0.26))
        roll = -np.degrees(1.6 * np.sin(1.4 * since) / 0.16)
        for x in (-0.25, 0.25):
            out.append(rod("rust", cart @ place(x, -0.16, -0.2, roll=roll, pitch=90), 0.16, 0.06))
            out.append(box("cream", cart @ place(x, -0.16, -0.235, roll=roll), (0.26, 0.05, 0.01)))
    return out


def hall(t, since):
    """The shapes of the second set. Its depths are 1.5 to 4.4, the yard's 2 to 7."""
    del since
    out = [
        box("oak", place(0, FLOOR + 0.1, 4), (16, 0.2, 12), (6, 4)),
        box("night", place(0, -1.2, 4.5), (16, 5, 0.4)),
        box("walnut", place(0, FLOOR - 0.35, 4.29), (16, 0.7, 0.04), (4, 1.4)),
        box("cream", place(0, FLOOR - 0.72, 4.27), (16, 0.05, 0.08)),
    ]
    for x, texture in ((-1.35, "rug"), (0.05, "poster"), (1.45, "leaf")):
        out.append(box("amber", place(x, -0.32, 4.29), (0.9, 1.14, 0.05)))
        out.append(box(texture, place(x, -0.32, 4.27), (0.8, 1.04, 0.05), (2.6, 2.6) if texture == "rug" else None))
    for k, texture in enumerate(("cream", "blue", "rust", "white")):
        out.append(
            box(texture, place(1.45, -0.32 + 0.07 * k, 4.245 - 0.005 * k), (0.62 - 0.15 * k, 0.8 - 0.2 * k, 0.01))
        )
    for x, z in ((-1.0, 3.3), (0.85, 3.6)):
        out.append(rod("white", place(x, FLOOR - 1.5, z), 0.13, 3.0, (1, 1)))
        out.append(box("white", place(x, FLOOR - 0.06, z), (0.36, 0.12, 0.36)))
    # A mobile, a drum, a pendulum, a table with a turning box, rails in front.
    for k, texture in enumerate(("red", "blue", "amber")):
        a = 2 * np.pi * (t / 2.4 + k / 3)
        x, z, y = 0.42 * np.cos(a), 2.75 + 0.42 * np.sin(a), -0.28 + 0.12 * k
        out.append(ball(texture, place(x, y, z), 0.11))
        out.append(rod("iron", place(x, (y - 1.6) / 2, z), 0.006, y + 1.6))
    out.append(rod("glaze", place(1.0, FLOOR - 0.45, 2.5, yaw=-100 * t), 0.3, 0.55, (1, 2), gloss=0.3))
    out.append(rod("cream", place(1.0, FLOOR - 0.09, 2.5), 0.34, 0.18))
    arm = place(-0.62, -1.3, 2.1, roll=swing(1.5, 20, t))
    out += [rod("iron", arm @ place(0, 0.65, 0), 0.009, 1.3), ball("rust", arm @ place(0, 1.35, 0), 0.13)]
    out.append(box("teal", place(-0.05, FLOOR - 0.55, 2.2), (0.95, 0.05, 0.5), (0.9, 0.45)))
    out += [
        rod("iron", place(-0.05 + x, FLOOR - 0.26, 2.2 + z), 0.018, 0.53) for x in (-0.4, 0.4) for z in (-0.18, 0.18)
    ]
    out.append(box("poster", place(0.05, FLOOR - 0.725, 2.2, yaw=-90 * t), (0.3, 0.3, 0.3), (0.6, 0.8)))
    for x in (0.42, 0.62):
        out.append(rod("rust", place(x, FLOOR - 0.85, 1.56), 0.014, 1.7))
    out += [rod("rust", place(0.52, FLOOR - h, 1.56, roll=90), 0.01, 0.2) for h in (0.6, 0.9, 1.2)]
    return out


SETS = (yard, hall)
