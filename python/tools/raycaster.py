"""A small ray caster of textured boxes, balls and rods, for make_rig_clip.py: 3×3 rays per pixel,
textures filtered to their footprint, a soft shadow.

World axes are OpenCV's (x right, y down, z forward).
"""

import numpy as np

from liveview_ref.data.image import to_u8

S = 3  # rays across a pixel
ROWS = 32  # rows of pixels drawn at once, few enough for the cache
LIGHT, SPREAD = np.array([-1.7, -3.6, 0.2]), 0.16  # position of the lamp that casts shadows, and half its width
FILL = np.array([0.5, -0.45, -0.74])  # direction of a weak light without shadows


class Texture:
    """A pyramid of linear colours, each level half the last."""

    def __init__(self, image):
        x = image / 255
        level = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4).astype(np.float32)
        self.levels = [level]
        while max(level.shape[:2]) > 1:
            h, w = (max(n // 2, 1) for n in level.shape[:2])
            level = level.reshape(h, level.shape[0] // h, w, level.shape[1] // w, 3).mean((1, 3))
            self.levels.append(level)

    def bilinear(self, level, u, v):
        table = self.levels[level]
        h, w = table.shape[:2]
        x, y = u * w - 0.5, v * h - 0.5
        x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
        fx, fy = (x - x0)[:, None], (y - y0)[:, None]
        rows = [table.reshape(-1, 3)[(y0 + k) % h * w + x0 % w] * (1 - fx) for k in (0, 1)]
        rows = [row + table.reshape(-1, 3)[(y0 + k) % h * w + (x0 + 1) % w] * fx for k, row in enumerate(rows)]
        return rows[0] + (rows[1] - rows[0]) * fy

    def __call__(self, u, v, footprint):
        """Colours [n, 3] at (u, v), in turns of the texture, over a footprint in texels of the
        finest level."""
        if len(self.levels) == 1:
            return np.broadcast_to(self.levels[0][0], (len(u), 3))
        level = np.clip(np.log2(np.maximum(footprint, 1)), 0, len(self.levels) - 1.001)
        out = np.empty((len(u), 3), np.float32)
        for k in np.unique(level.astype(int)):
            on = level.astype(int) == k
            near, far = (self.bilinear(k + i, u[on], v[on]) for i in (0, 1))
            out[on] = near + (far - near) * (level[on] - k)[:, None]
        return out


def hit(shape, o, d):
    """Distance along local rays o + t·d, each three arrays, to a shape; infinite for a miss or
    behind 0.001."""
    if shape.kind == "box":
        low, high = -np.inf, np.inf
        for a, b, half in zip(o, d, shape.half, strict=True):
            p, q = (-half - a) / b, (half - a) / b
            low, high = np.maximum(low, np.minimum(p, q)), np.minimum(high, np.maximum(p, q))
    else:
        axes = (0, 1, 2) if shape.kind == "ball" else (0, 2)
        a, b = sum(d[k] ** 2 for k in axes), sum(o[k] * d[k] for k in axes)
        root = b * b - a * (sum(o[k] ** 2 for k in axes) - shape.half[0] ** 2)
        root = np.sqrt(np.where(root < 0, np.nan, root))
        low, high = (-b - root) / a, (-b + root) / a
        if shape.kind == "rod":
            p, q = (-shape.half[1] - o[1]) / d[1], (shape.half[1] - o[1]) / d[1]
            low, high = np.maximum(low, np.minimum(p, q)), np.minimum(high, np.maximum(p, q))
    return np.where((low < high) & (low > 1e-3), low, np.inf)  # NaN is a miss


def surface(shape, p):
    """Normal, u, v and turns of the texture per unit along them, at the local surface points p,
    three arrays."""
    x, y, z = p
    rx, ry, rz = shape.half
    if shape.kind == "box":
        face = np.argmax([np.abs(x) / rx, np.abs(y) / ry, np.abs(z) / rz], axis=0)
        n = [np.where(face == k, np.sign(p[k]), 0) for k in range(3)]
        # Signed, so that no side is mirrored.
        along = np.where(face == 0, z * np.sign(x), np.where(face == 2, -x * np.sign(z), x))
        u, ru = along, np.where(face == 0, rz, rx)
        v, rv = np.where(face == 1, z, y), np.where(face == 1, rz, ry)
        tile = shape.tile or (2 * ru, 2 * rv)
        return n, (u + ru) / tile[0], (v + rv) / tile[1], 1 / tile[0], 1 / tile[1]
    turn, tile = np.arctan2(x, z) / (2 * np.pi), shape.tile or (1, 1)
    if shape.kind == "ball":
        return [x / rx, y / rx, z / rx], turn, np.arccos(np.clip(y / rx, -1, 1)) / np.pi, 1 / (6.3 * rx), 1 / (3.1 * rx)
    cap = ry - np.abs(y) < 1e-3 * ry + 1e-5
    n = [np.where(cap, 0, x / rx), np.where(cap, np.sign(y), 0), np.where(cap, 0, z / rx)]
    u, v = np.where(cap, x, turn / tile[0]), np.where(cap, z, (y + ry) / (2 * ry * tile[1]))
    return n, u, v, 1 / (6.3 * rx * tile[0]), 1 / (2 * ry * tile[1])


def rays(camera, width, height, per_pixel):
    """World ray directions through a picture, of length 1 along the camera's z, as x [1, w] and y
    [h, 1] at z = 1."""
    x, y = ((np.arange(n * per_pixel, dtype=np.float32) + 0.5) / per_pixel - n / 2 for n in (width, height))
    focal = float(camera[0])  # a NumPy scalar would turn everything into double precision
    return x[None] / focal, y[:, None] / focal


def window(shape, camera, x, y):
    """Slices of the rays that may hit a shape."""
    corners = np.stack(np.meshgrid(*([-h, h] for h in shape.half), [1], indexing="ij"), -1).reshape(-1, 4)
    pose = camera[1]
    p = ((corners @ shape.at.T)[:, :3] - pose[:, 3]) @ pose[:, :3]
    if p[:, 2].min() < 0.1:
        return slice(None), slice(None)
    spans = zip((p[:, 1] / p[:, 2], p[:, 0] / p[:, 2]), (y[:, 0], x[0]), strict=True)
    return tuple(slice(*np.searchsorted(grid, (q.min(), q.max()))) for q, grid in spans)


def local(shape, points):
    """World points [..., 3] in a shape's own axes, as [3, ...], and its rotation, world from
    local."""
    r, c = shape.at[:3, :3].astype(np.float32), shape.at[:3, 3].astype(np.float32)
    return np.moveaxis((points - c) @ r, -1, 0), r


def cast(shapes, camera, x, y):
    """Depth and index of the first shape along every ray."""
    depth = np.full((y.size, x.size), np.inf, np.float32)
    first = np.zeros(depth.shape, np.int16)
    pose = camera[1].astype(np.float32)
    for k, shape in enumerate(shapes):
        on = window(shape, camera, x, y)
        o, r = local(shape, pose[:, 3])
        t = hit(shape, o, [a[0] * x[:, on[1]] + a[1] * y[on[0]] + a[2] for a in r.T @ pose[:, :3]])
        first[on][t < depth[on]] = k
        np.minimum(depth[on], t, out=depth[on])
    return depth, first


def lit(shapes, p, n, pick):
    """Light on world points p [m, 3] of normal n, from the lamp's point of each `pick` (0 to 8),
    shadow included."""
    i, j = (np.arange(S * S) // S - 1) / S, (np.arange(S * S) % S - 1) / S
    # Rotated: nine shadow edges instead of three.
    points = LIGHT + 2 * SPREAD * np.stack([i + j / S, 0 * i, j - i / S], 1)
    to = points.astype(np.float32)[pick] - p
    length = np.linalg.norm(to, axis=1)
    facing = np.maximum((to * n).sum(1) / length, 0)
    start = p + 2e-3 * n
    axis = p - LIGHT.astype(np.float32)
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    for shape in shapes[2:]:
        centre, radius = shape.at[:3, 3] - LIGHT, np.linalg.norm(shape.half) + SPREAD
        away = np.linalg.norm(centre)
        cone = np.sqrt(max(1 - (radius / away) ** 2, 0))
        on = np.nonzero((axis @ (centre / away).astype(np.float32) > cone) & (length > away - radius) & (facing > 0))[0]
        if on.size:
            o, r = local(shape, start[on])
            t = hit(shape, o, (to[on] @ r).T)
            facing[on[t < 1]] = 0
    return facing * 20 / length**2, to / length[:, None]


def picture(shapes, textures, camera, width, height):
    """8-bit sRGB [height, width, 3] of shapes (as scene.py describes them), of which the first two
    cast no shadow.

    camera: focal length in pixels, world from camera [3, 4], OpenCV axes; textures:
    name -> Texture.
    """
    x, y = rays(camera, width, height, S)
    bands = np.split(y, range(S * ROWS, len(y), S * ROWS))
    colour = np.vstack([linear(shapes, textures, camera, x, band) for band in bands])
    colour = np.where(colour < 0.7, colour, 0.7 + 0.3 * np.tanh((colour - 0.7) / 0.3))
    colour = np.where(colour < 0.0031308, 12.92 * colour, 1.055 * np.maximum(colour, 1e-9) ** (1 / 2.4) - 0.055)
    return to_u8(colour)


def linear(shapes, textures, camera, x, y):
    """Linear colours of pixels, from S×S rays each."""
    depth, first = cast(shapes, camera, x, y)
    pose = camera[1].astype(np.float32)
    d = pose[:, 0] * x[..., None] + pose[:, 1] * y[..., None] + pose[:, 2]
    p = (pose[:, 3] + depth[..., None] * d).reshape(-1, 3)
    n, albedo, gloss = np.empty_like(p), np.empty_like(p), np.zeros(len(p), np.float32)
    back = -d.reshape(-1, 3) / np.linalg.norm(d, axis=-1).reshape(-1, 1)
    order = np.argsort(first, None, kind="stable")
    ends = np.cumsum(np.bincount(first.ravel(), minlength=len(shapes)))
    for shape, on in zip(shapes, np.split(order, ends[:-1]), strict=True):
        q, r = local(shape, p[on])
        normal, u, v, du, dv = surface(shape, q)
        n[on] = np.stack(normal, 1) @ r.T
        h, w = textures[shape.texture].levels[0].shape[:2]
        slant = np.clip((n[on] * back[on]).sum(1), 0.05, 1)
        footprint = depth.ravel()[on] / (S * float(camera[0])) * np.sqrt(w * du * h * dv / slant)
        albedo[on], gloss[on] = textures[shape.texture](u, v, footprint), shape.gloss
    row, column = np.indices(depth.shape, np.int16)
    key, to = lit(shapes, p, n, (row % S * S + column % S).ravel())
    ambient = 0.34 - 0.14 * n[:, 1] + 0.32 * np.maximum(n @ FILL.astype(np.float32), 0)
    half = to + back
    shine = np.maximum((half * n).sum(1) / np.linalg.norm(half, axis=1), 0) ** 60 * gloss * key
    colour = albedo * np.stack([key * w + ambient * c for w, c in zip((1, 0.93, 0.8), (0.94, 1, 1.1), strict=True)], 1)
    return (colour + shine[:, None]).reshape(y.size // S, S, x.size // S, S, 3).mean((1, 3))
