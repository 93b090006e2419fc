"""The workshop scene: textures, shapes and lights; python/tools/make_example_scene.py renders it.

World axes are OpenCV's (x right, y down, z forward); a length of 1 is about a metre.
"""

from itertools import pairwise

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from liveview_ref.data.image import to_u8

FLOOR, WALL, SIDE = 1.45, 6.9, 2.4  # y of the floor, z of the back wall, |x| of the side walls


def noise(rng, h, w, fy, fx, power=1.2):
    """Tileable 1/f noise of unit variance with a flat spectrum below fy and fx cycles; fy > fx
    stretches it along x."""
    ky, kx = np.fft.fftfreq(h)[:, None] * h / fy, np.fft.rfftfreq(w)[None] * w / fx
    gain = (1 + ky**2 + kx**2) ** (-power / 2) * (ky**2 + kx**2 > 0)
    out = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((h, w))) * gain, (h, w))
    return out / out.std()


def ramp(t, *colours):
    """Maps t in [0, 1] to a ramp through sRGB hex colours."""
    table = np.array([[int(c[i : i + 2], 16) / 255 for i in (0, 2, 4)] for c in colours])
    t = np.clip(t, 0, 1) * (len(colours) - 1)
    return np.stack([np.interp(t, range(len(colours)), table[:, k]) for k in range(3)], -1)


def cells(h, w, p, q):
    """Row and column of each texel's p×q cell, and its distance from the cell's edge."""
    y, x = np.mgrid[0:h, 0:w].astype(float)
    x = x + (p != q) * (y // p % 2) * q / 2  # oblong cells are offset like bricks
    edge = np.minimum(np.minimum(y % p, p - y % p), np.minimum(x % q, q - x % q))
    return (y // p).astype(int), (x // q).astype(int) % (w // q), edge


def textures(rng):
    """Every bitmap of the scene, by name."""
    out = {}
    y, x = np.mgrid[0:512, 0:1024] / 512
    woods = {"oak": "7a4a22 b9834a dcb27c", "walnut": "2c1a10 5b3922 8a603c", "teal": "1d4a50 2f727a 58a0a2"}
    for name, colours in woods.items():
        grain = 0.5 + 0.5 * np.sin(2 * np.pi * 7 * (y + 0.06 * noise(rng, 512, 1024, 3, 1.2, 3)))
        fine = noise(rng, 512, 1024, 120, 3, 1.6)
        out[name] = ramp(0.2 + 0.45 * grain**1.7 + 0.13 * fine, *colours.split())
    h, w = 38 * 54, 20 * 102
    i, j, edge = cells(h, w, 54, 102)
    tone = 0.1 + 0.6 * rng.random((38, 20))[i, j] + 0.1 * noise(rng, h, w, 80, 80)
    mortar = np.clip((7 - edge - 1.2 * noise(rng, h, w, 200, 200)) / 3, 0, 1)[..., None]
    out["brick"] = ramp(tone, "6f3a2a", "a85a3f", "c77f5c", "dcae8c") * (1 - mortar) + mortar * 0.74
    i, j, edge = cells(2016, 2016, 112, 112)
    tone = 0.2 + 0.55 * ((i + j) % 2) + 0.14 * rng.random((18, 18))[i, j] + 0.045 * noise(rng, 2016, 2016, 40, 40)
    out["tile"] = np.where((edge < 3)[..., None], 0.4, ramp(tone, "33454d", "6f8488", "d9d2c2", "efe9dc"))
    i, j, edge = cells(1080, 1080, 12, 12)
    over, band = (i + j) % 2 == 0, (1, 2, 4, 8, 9, 10)
    thread = 0.25 + 0.12 * edge + 0.08 * rng.standard_normal((90, 90))[i, j]
    stripe = np.isin(i % 15, band) & over | np.isin(j % 15, band) & ~over
    for name, a, b, low in (("cloth", "f4ecd8", "2b5d9c", "101820"), ("shade", "fff4dc", "f3d49c", "a8977a")):
        out[name] = np.where(stripe[..., None], ramp(thread, low, b), ramp(thread, "7a6f5c", a))
    i, j = np.mgrid[0:1024, 0:1024]
    ring = (np.abs(i // 8 * 8 % 128 - 60) + np.abs(j // 8 * 8 % 128 - 60)) * 6 // 128  # nested, stepped diamonds
    ring = ring + 3 * ((i // 128 + j // 128) % 2)
    rug = ramp(ring % 6 / 5, "e8d9b5", "c8452f", "20394f", "d99a35", "7a2430", "efe4c8")
    out["rug"] = rug * np.clip(0.92 + 0.07 * noise(rng, 1024, 1024, 90, 90), 0.5, 1.08)[..., None]
    tone = 0.55 + 0.16 * noise(rng, 768, 1024, 4, 4, 1.6) + 0.09 * noise(rng, 768, 1024, 70, 70)
    y, x = np.mgrid[0:768, 0:1024]
    boards = ramp(0.55 + 0.15 * noise(rng, 768, 1024, 3, 60) - 0.5 * (x % 32 < 4), "15292e", "2f5560", "5d8a90")
    out["wall"] = np.where((y > 500)[..., None], boards, ramp(tone, "b09a72", "d9c79f", "f0e6cb"))
    out["wall"][494:510] = 0.85
    y, x = np.mgrid[0:512, 0:1024]
    zigzag = (y + np.abs(x % 64 - 32)) % 512 // 32 % 4
    out["glaze"] = ramp(zigzag / 3 + 0.06 * noise(rng, 512, 1024, 30, 30), "f1e6d0", "2c6f86", "173b52", "e2a23c")
    out["poster"] = poster(rng, 1440, 1920)
    return out


def poster(rng, w, h):
    """A printed sheet with a title, sun and hills, and columns of small print. It is drawn at twice
    its size and then downsampled."""
    img = Image.new("RGB", (w, h), "#f3ead6")
    d, font = ImageDraw.Draw(img), ImageFont.load_default
    d.rectangle((60, 330, w - 60, 1270), fill="#f0b54a")
    for k, r in enumerate(range(330, 20, -36)):
        d.ellipse((w / 2 - r, 720 - r, w / 2 + r, 720 + r), fill=("#d9442e", "#f6dfae")[k % 2])
    x = np.arange(60, w - 59, 4)
    for k, c in enumerate(("#3f7f86", "#275764", "#17323f")):
        y = 960 + 90 * k + 80 * np.sin(x / (150 + 40 * k) + 2.1 * k) + 28 * np.sin(x / 47 + k)
        d.polygon([(60, 1270), *zip(x.tolist(), y.tolist(), strict=True), (w - 60, 1270)], fill=c)
    d.text((w / 2, 190), "LIVE VIEW", fill="#17323f", font=font(270), anchor="mm")
    d.text((w / 2, 1370), "a new view from a few", fill="#d9442e", font=font(130), anchor="mm")
    for col, line in np.ndindex(3, 10):
        px, end = 70 + col * 450, 70 + col * 450 + rng.integers(300, 400)
        while px < end:
            n = int(rng.integers(14, 70))
            d.rectangle((px, 1490 + 40 * line, min(px + n, end), 1508 + 40 * line), fill="#33302c")
            px += n + 14
    return np.asarray(img.resize((w // 2, h // 2), Image.Resampling.BOX)) / 255


def frame(x=0.0, y=0.0, z=0.0, yaw=0.0):
    """A local frame at (x, y, z), rotated about the vertical by yaw degrees."""
    c, s = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    return np.array([[c, 0, s, x], [0, 1, 0, y], [-s, 0, c, z], [0, 0, 0, 1]])


class Builder:
    """Collects shapes, each with a named material, into a Mitsuba scene dictionary."""

    def __init__(self, mi):
        self.mi, self.shapes, self.materials = mi, {"type": "scene"}, {}

    def material(self, name, colour, repeat=(1, 1), gloss=None):
        """Adds a material from an sRGB hex colour or an image. gloss: roughness of its plastic
        coating, None for a diffuse material."""
        if isinstance(colour, str):
            tex = {"type": "rgb", "value": (ramp(np.zeros(()), colour, colour) ** 2.2).tolist()}
        else:
            image = self.mi.Bitmap(to_u8(colour))
            tex = {"type": "bitmap", "bitmap": image, "to_uv": self.mi.ScalarTransform4f().scale([*repeat, 1])}
        bsdf = {"type": "diffuse", "reflectance": tex}
        if gloss:
            bsdf = {"type": "roughplastic", "diffuse_reflectance": tex, "alpha": gloss, "nonlinear": True}
        self.materials[name] = self.mi.load_dict({"type": "twosided", "bsdf": bsdf})

    def add(self, kind, name, **more):
        self.shapes[f"shape_{len(self.shapes)}"] = {"type": kind, "bsdf": self.materials[name], **more}

    def box(self, name, centre, size, at=None):
        m = (frame() if at is None else at) @ frame(*centre) @ np.diag([*np.array(size) / 2, 1])
        self.add("cube", name, to_world=self.mi.ScalarTransform4f(m))

    def quad(self, name, centre, u, v, **more):
        """Adds the rectangle centre ± u ± v. Texture rows run along v, columns along u; the front
        faces u × v."""
        n = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
        m = np.vstack([np.column_stack([u, v, n, centre]), [0, 0, 0, 1]])
        self.add("rectangle", name, to_world=self.mi.ScalarTransform4f(m), **more)

    def ball(self, name, centre, radius):
        self.add("sphere", name, center=list(map(float, centre)), radius=radius)

    def rod(self, name, points, radius):
        """Adds a polyline of cylinders with round joints."""
        for a, b in pairwise(points):
            self.add("cylinder", name, p0=list(map(float, a)), p1=list(map(float, b)), radius=radius)
        for a in points:
            self.ball(name, a, radius)

    def surface(self, name, p):
        """Adds a smooth mesh through a grid of points [h, w, 3]."""
        h, w = p.shape[:2]
        k = np.arange(h * w).reshape(h, w)
        a, b, c, d = (q.ravel() for q in (k[:-1, :-1], k[:-1, 1:], k[1:, :-1], k[1:, 1:]))
        props = self.mi.Properties()
        props["bsdf"] = self.materials[name]
        mesh = self.mi.Mesh("grid", h * w, 2 * len(a), props, has_vertex_normals=True, has_vertex_texcoords=True)
        params = self.mi.traverse(mesh)
        v, u = np.mgrid[0 : 1 : h * 1j, 0 : 1 : w * 1j]
        params["vertex_positions"] = p.ravel().tolist()
        params["vertex_texcoords"] = np.stack([u, v], -1).ravel().tolist()
        params["faces"] = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)]).ravel().tolist()
        params.update()
        self.shapes[f"shape_{len(self.shapes)}"] = mesh

    def lathe(self, name, at, radii, heights, smooth=True):
        """Adds a surface of revolution: a profile rotated about the vertical through `at`. With
        smooth=False its corners stay sharp."""
        t = np.linspace(0, 2 * np.pi, 65) + np.pi / 2
        r, y = np.asarray(radii, float)[:, None], -np.asarray(heights, float)[:, None]
        p = np.stack([r * np.cos(t), y + 0 * t, r * np.sin(t)], -1) + at
        for part in [p] if smooth else np.stack([p[:-1], p[1:]], 1):
            self.surface(name, part)


def build(mi):
    """The Mitsuba scene: in front a bench with a plant, a lantern and a ball; behind it a chair, a
    lamp and a ladder; at the back a bookcase, a poster and a brick wall."""
    rng = np.random.default_rng(7)
    s, tex = Builder(mi), textures(rng)
    for name in ("oak", "walnut", "teal", "tile", "poster", "wall", "rug", "cloth"):
        s.material(name, tex[name])
    s.material("brick", tex["brick"], (1.4, 1.4))
    s.material("shade", tex["shade"], (2, 1))
    s.material("glaze", tex["glaze"], gloss=0.15)
    s.material("red", "c8281e", gloss=0.08)
    names = ("iron", "white", "leaf", "moss", "amber", "blue", "rust")
    for name, colour in zip(names, ("2a2c30", "f2eee4", "6fae45", "3f7d3c", "f0a326", "2a5f9e", "b4492c"), strict=True):
        s.material(name, colour)
    # The room and two area lights: one overhead, a larger and weaker one behind the cameras.
    s.quad("tile", (0, FLOOR, 4), (3.6, 0, 2.1), (2.1, 0, -3.6))
    s.quad("brick", (0, -0.7, WALL), (SIDE, 0, 0), (0, 2.4, 0))
    s.quad("wall", (-SIDE, -0.2, 3), (0, 0, 4), (0, 1.65, 0))
    s.quad("wall", (SIDE, -0.2, 3), (0, 0, -4), (0, 1.65, 0))
    s.box("white", (0, FLOOR - 0.07, WALL - 0.02), (2 * SIDE, 0.14, 0.04))
    for centre, u, v, rgb in (
        ((-0.6, -2.6, 3.6), (1.5, 0, 0), (0, 0, -1.9), (6.6, 6.1, 5.4)),
        ((-2.0, -1.9, -1.6), (1.4, 0, -1.0), (-0.33, 0.96, -0.45), (3.7, 3.9, 4.3)),
    ):
        s.quad("white", centre, u, v, emitter={"type": "area", "radiance": {"type": "rgb", "value": rgb}})
    # The bench.
    bench = frame(-0.52, 0.5, 1.62, -9)
    s.box("oak", (0, 0.03, 0), (1.3, 0.06, 0.72), bench)
    s.box("walnut", (0, 0.12, 0), (1.2, 0.12, 0.62), bench)
    for x, z in ((0.52, 0.28), (0.52, -0.28)):
        s.box("oak", (x, 0.5, z), (0.07, 0.9, 0.07), bench)
    s.box("cloth", (0.17, -0.003, -0.05), (0.5, 0.006, 0.5), bench)
    vase = np.array([-0.4, 0.494, 1.62])
    z = np.linspace(0, 1, 33)
    s.lathe("glaze", vase, 0.05 + 0.055 * np.sin(np.pi * z**0.8) ** 1.5 - 0.012 * z, 0.25 * z)
    for k in range(8):
        out = np.array([np.cos(2.4 * k + 0.5), 0, np.sin(2.4 * k + 0.5)]) * rng.uniform(0.1, 0.26)
        t = np.linspace(0, 1, 9)[:, None]
        stem = vase + [0, -0.16, 0] + [0, -rng.uniform(0.38, 0.62), 0] * t + out * t**2
        s.rod("moss", stem, 0.0032)
        for i in np.arange(4, 18) // 2:
            yaw, size = rng.uniform(0, 6.3), rng.uniform(0.07, 0.12)
            ahead, side = np.array([np.cos(yaw), -0.5, np.sin(yaw)]), np.array([-np.sin(yaw), 0.15, np.cos(yaw)])
            a, b = np.linspace(0, 1, 9)[:, None, None], np.linspace(-1, 1, 5)[None, :, None]
            blade = a * ahead + 0.2 * np.sin(np.pi * a) * b * side + [0, 0.55, 0] * a**2 - [0, 0.06, 0] * b**2
            s.surface(("leaf", "moss")[(i + k) % 2], stem[i] + size * blade)
    s.ball("red", (-0.17, 0.404, 1.47), 0.09)
    s.ball("amber", (-0.33, 0.459, 1.38), 0.035)
    for k, (name, h) in enumerate((("blue", 0.045), ("rust", 0.03), ("cloth", 0.04))):
        s.box(name, (-0.22, -0.0225 - 0.045 * k, 0.1), (0.2 - 0.02 * k, h, 0.26 - 0.03 * k), bench @ frame(yaw=14 * k))
    cage, turn = np.array([0.02, 0.5, 1.72]), np.linspace(0, 2 * np.pi, 15)
    circle = np.stack([np.cos(turn), 0 * turn, np.sin(turn)], -1)
    for height, r in ((0.008, 0.11), (0.13, 0.11), (0.27, 0.11), (0.35, 0.03)):
        s.rod("iron", cage + r * circle - [0, height, 0], 0.0045)
    for c in circle[:-1]:
        s.rod("iron", [cage + 0.11 * c, cage + 0.11 * c - [0, 0.27, 0], cage + 0.03 * c - [0, 0.35, 0]], 0.003)
    s.lathe("white", cage, [1e-3, 0.045, 0.045], [0.17, 0.17, 0], smooth=False)
    # Middle distance: rug, chair with slats, lamp on a thin pole, ladder, pendant lamps, stool.
    s.quad("rug", (0.75, FLOOR - 0.006, 3.7), (1.1, 0, 0.25), (0.2, 0, -0.85))
    chair = frame(0.62, FLOOR, 3.15, 152)
    for x, z, h in ((-0.2, -0.2, 1.12), (0.2, -0.2, 1.12), (-0.2, 0.2, 0.45), (0.2, 0.2, 0.45)):
        s.box("teal", (x, -h / 2, z), (0.04, h, 0.04), chair)
    s.box("teal", (0, -0.46, 0.01), (0.46, 0.03, 0.46), chair)
    for h, size in ((1.08, 0.07), (0.58, 0.05)):
        s.box("teal", (0, -h, -0.2), (0.42, size, 0.025), chair)
    for x in np.linspace(-0.14, 0.14, 5):
        s.box("teal", (x, -0.83, -0.2), (0.022, 0.5, 0.014), chair)
    lamp = np.array([0.86, FLOOR, 2.15])
    s.rod("iron", [lamp, lamp - [0, 1.66, 0]], 0.009)
    s.lathe("iron", lamp, [0.14, 0.14, 1e-3], [0, 0.015, 0.02], smooth=False)
    s.lathe("shade", lamp - [0, 1.42, 0], [0.1, 0.17], [0.26, 0])
    for x, z, y in ((-1.02, 4.3, -0.42), (0.36, 3.7, -0.42), (0.98, 5.3, -0.5)):
        s.rod("iron", [(x, -2.5, z), (x, y, z)], 0.006)
        s.lathe("rust", (x, y + 0.16, z), [0.2, 0.18, 0.12, 0.03, 0.03], [0, 0.05, 0.12, 0.16, 0.2])
        s.ball("white", (x, y + 0.13, z), 0.055)
    foot, top = np.array([-1.75, FLOOR, 4.9]), np.array([-1.7, -1.7, 6.6])
    for x in (-0.22, 0.22):
        s.rod("oak", [foot + [x, 0, 0], top + [x * 0.8, 0, 0]], 0.022)
    for t in np.linspace(0.09, 0.95, 11):
        s.rod("oak", [foot + (top - foot) * t + [x * (1 - 0.2 * t), 0, 0] for x in (-0.22, 0.22)], 0.014)
    s.lathe("walnut", (1.55, FLOOR, 4.6), [0.2, 0.2, 0.24, 0.24, 1e-3], [0, 0.46, 0.46, 0.5, 0.5], smooth=False)
    s.ball("glaze", (1.55, FLOOR - 0.68, 4.6), 0.18)
    # Back of the room: poster, bookcase.
    s.quad("poster", (-0.55, -0.1, WALL - 0.02), (0.62, 0, 0), (0, 0.83, 0))
    case = frame(0.95, FLOOR, WALL - 0.16)
    for x in (-0.72, 0, 0.72):
        s.box("walnut", (x, -1.05, 0), (0.04, 2.1, 0.3), case)
    for h in (0.1, 0.5, 0.9, 1.3, 1.7, 2.1):
        s.box("walnut", (0, -h, 0), (1.48, 0.03, 0.3), case)
        for x0 in (-0.69, 0.03) if h < 2 else ():
            x, end = x0, x0 + rng.uniform(0.4, 0.64)
            while x < end:
                w, tall = rng.uniform(0.03, 0.07), rng.uniform(0.22, 0.33)
                name = ("blue", "rust", "amber", "white", "moss", "leaf", "cloth", "teal")[rng.integers(8)]
                s.box(name, (x + w / 2, -h - 0.015 - tall / 2, -0.02), (w - 0.006, tall, 0.2), case)
                x += w
    return mi.load_dict(s.shapes, parallel=False, optimize=False)  # a fixed order gives reproducible noise
