"""Make this scene, on which live parity compares what the example scene does not reach: walls
without texture, narrow things before them, holes, soft photos, a thing that moves.

Usage: python tests/scenes/walls/scene.py
"""

import json
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

OUT = Path(__file__).resolve().parent
W, H, FOCAL = 96, 72, 84.0
S = 3  # rays across a pixel
CHANGES = -1.0
# Upright rectangles: depth, left, right, top, bottom (scene units); colour; contrast of their
# texture; how far they move from photo to photo (or whether their texture changes).
RECTANGLES = (
    (9.0, -16, 9, -6, 6, (0.80, 0.78, 0.74), 0.0, 0.0),  # a plain wall
    (8.9, -16, -2.2, -6, 6, (0.45, 0.55, 0.40), 0.5, 0.0),  # a wall with texture
    (8.8, 0.2, 9, -6, 6, (0.35, 0.50, 0.62), 0.5, CHANGES),  # no two photos agree
    (6.0, 0.4, 2.0, 0.2, 6, (0.62, 0.60, 0.66), 0.02, 0.0),  # a plain box
    (4.5, -2.2, -1.0, -0.6, 0.8, (0.55, 0.30, 0.25), 0.6, 0.0),
    (3.0, 0.5, 0.58, -6, 6, (0.15, 0.15, 0.16), 0.1, 0.0),  # two posts
    (2.5, -0.75, -0.6, -6, 6, (0.85, 0.70, 0.30), 0.3, 0.0),
    (3.5, -0.2, 0.3, 0.5, 1.0, (0.25, 0.35, 0.70), 0.6, 0.09),  # moves
    (1.8, 0.55, 1.2, 0.35, 1.6, (0.70, 0.68, 0.30), 0.5, 0.0),
)
CENTRES = (
    (0.02, 0.01),
    (-0.3, 0.0),
    (0.28, 0.05),
    (0.02, -0.25),
    (0.05, 0.27),
    (-0.2, 0.22),
    (-4.5, -0.2),
)  # the last sees much that no other does
NAMES = ("target", *(f"photo_{i}" for i in range(6)))
SOFT = ("photo_3", "photo_4")


def texture(u: np.ndarray, v: np.ndarray, seed: int) -> np.ndarray:
    """Waves in -1 to 1 of many directions."""
    rng = np.random.default_rng(seed)
    angles, lengths = rng.uniform(0, np.pi, 12), 0.08 * 1.35 ** rng.uniform(0, 10, 12)
    waves = (np.sin((u * np.cos(a) + v * np.sin(a)) * 6.28 / n + a) for a, n in zip(angles, lengths, strict=True))
    return sum(waves) / 5


def photo(centre: tuple[float, float], step: int) -> Image.Image:
    """Linear in the colours, from S x S rays a pixel, with noise: equal costs would be decided by
    rounding."""
    y, x = ((np.arange(n * S) + 0.5) / S - n / 2 for n in (H, W))
    x, y = x[None] / FOCAL, y[:, None] / FOCAL
    out = np.zeros((H * S, W * S, 3))
    for seed, (z, left, right, top, bottom, colour, contrast, moves) in enumerate(RECTANGLES):
        u, v = np.broadcast_arrays(centre[0] + z * x, centre[1] + z * y)
        shift = max(moves, 0) * step
        on = (u > left + shift) & (u < right + shift) & (v > top) & (v < bottom)
        shade = 1 + contrast * texture(u - shift, v, seed + (100 * step if moves == CHANGES else 0))[..., None]
        out = np.where(on[..., None], np.array(colour) * shade, out)
    levels = out.reshape(H, S, W, S, 3).mean((1, 3)) * 255 + np.random.default_rng(step).normal(0, 1, (H, W, 3))
    return Image.fromarray(levels.round().clip(0, 255).astype(np.uint8))


def main() -> None:
    (OUT / "images").mkdir(parents=True, exist_ok=True)
    frames = []
    for step, (name, (x, y)) in enumerate(zip(NAMES, CENTRES, strict=True)):
        picture = photo((x, y), step)
        picture = picture.filter(ImageFilter.GaussianBlur(1.1)) if name in SOFT else picture
        picture.save(OUT / "images" / f"{name}.png")
        # OpenGL's axes: y up, z backwards.
        matrix = [[1, 0, 0, x], [0, -1, 0, y], [0, 0, -1, 0], [0, 0, 0, 1]]
        frames.append({"file_path": f"images/{name}.png", "transform_matrix": matrix})
    camera = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": W / 2, "cy": H / 2, "w": W, "h": H}
    (OUT / "transforms.json").write_text(json.dumps({**camera, "frames": frames}, indent=1) + "\n")


if __name__ == "__main__":
    main()
