"""DeepFocus's light fields (Xiao et al., "DeepFocus", SIGGRAPH Asia 2018), as its repository facebookresearch/DeepFocus
unpacks them: lightfield/data/seedNNNN/512/frame_rgbVVVV.exr and frame_depthVVVV.exr, 86 scenes of 9x9 views.

As its lightfield/code/preprocess.py reads them: view V stands in row V // 9 and column V % 9; colours are linear,
raised to 1/2.2 and cut off at 1; the first channel of a depth file is the depth in metres. Scenes 0 to 65 are for
training, 66 to 75 for validation, 76 to 85 for test (train-llf4d.py). Its five inputs are the corners and the middle of
the grid, as here; the paper names neither the cameras of its views nor its targets. Four views are the corners, ten are
two quincunxes side by side, and the six targets are never an input.

No file holds the cameras. They are found from the pictures: of parallel cameras on a grid only the product of focal
length and spacing shows, so a point at depth z moves by parallax / z - shift pixels from a view to its neighbour, with
one parallax and one shift for each axis, which are fitted by the colours of views that the depth of the middle one is
carried to. Reading needs the package OpenEXR (make setup-evaluation)."""

import math
from functools import cache
from pathlib import Path
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ..reference.geometry.camera import Camera
from .captured import CapturedScene

GRID = 9
MIDDLE = GRID // 2
SPLITS = {"train": range(66), "validation": range(66, 76), "test": range(76, 86)}
_CORNERS = [(0, 0), (0, 8), (8, 0), (8, 8)]  # (column, row)
_LEFT, _RIGHT = [(0, 0), (0, 8), (3, 0), (3, 8)], [(5, 0), (5, 8), (8, 0), (8, 8)]
VIEWS = {4: _CORNERS, 5: [(4, 4), *_CORNERS], 10: [(2, 4), *_LEFT, (6, 4), *_RIGHT]}
REFERENCES = {4: (0,), 5: (0,), 10: (0, 5)}
TARGETS = [(2, 2), (4, 2), (6, 2), (2, 6), (4, 6), (6, 6)]
WORST_FIT = 0.5  # of the error that the views have as they are: above it the cameras count as not found


class Grid(NamedTuple):
    """Parallax, pixels times metres, and shift, pixels, from a view to the next column and to the next row."""

    parallax: tuple[float, float]
    shift: tuple[float, float]

    def camera(self, column: int, row: int, width: int, height: int) -> Camera:
        """Of a view; its focal length is that of 60 degrees, and the spacing goes with it."""
        focal = width / 2 / math.tan(math.radians(30))
        steps = column - MIDDLE, row - MIDDLE
        middle = [size / 2 + step * shift for size, step, shift in zip((width, height), steps, self.shift, strict=True)]
        centre = [step * parallax / focal for step, parallax in zip(steps, self.parallax, strict=True)]
        k = torch.tensor([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]], dtype=torch.float64)
        translation = torch.tensor([-centre[0], -centre[1], 0.0], dtype=torch.float64)
        return Camera(k, torch.eye(3, dtype=torch.float64), translation, width, height)


class DeepFocus:
    """The scenes of a split ("train", "validation" or "test") in lightfield/data, for a number of views."""

    def __init__(self, folder: Path, split: str, views: int):
        if views not in VIEWS:
            raise ValueError(f"DeepFocus has no configuration of {views} views; expected {', '.join(map(str, VIEWS))}")
        self.views = views
        self.scenes = [path for n in SPLITS[split] if (path := folder / f"seed{n:04}" / "512").is_dir()]
        if not self.scenes:
            expected = " to ".join(f"seed{SPLITS[split][i]:04}/512" for i in (0, -1))
            raise ValueError(f"{folder}: no scene of the {split} split; expected {expected}")

    def __len__(self) -> int:
        return len(self.scenes)

    def __getitem__(self, number: int) -> CapturedScene:
        return read_scene(self.scenes[number], self.views, find_grid(self.scenes[0]))


def read_scene(folder: Path, views: int, grid: Grid) -> CapturedScene:
    """The inputs and the targets of a scene."""
    images = {place: read_image(folder, place) for place in (*VIEWS[views], *TARGETS)}
    height, width = next(iter(images.values())).shape[1:]
    if any(image.shape[1:] != (height, width) for image in images.values()):
        raise ValueError(f"{folder}: pictures of different sizes")
    depths = [read_depth(folder, place) for place in TARGETS]
    every = torch.stack(depths)

    def cameras(places: list[tuple[int, int]]) -> list[Camera]:
        return [grid.camera(*place, width, height) for place in places]

    return CapturedScene(
        folder.parent.name,
        [(images[place] * 255).round().to(torch.uint8) for place in VIEWS[views]],
        cameras(VIEWS[views]),
        REFERENCES[views],
        [f"{view(place):04}" for place in TARGETS],
        [(images[place] * 255).round().to(torch.uint8) for place in TARGETS],
        cameras(TARGETS),
        [1 / depth for depth in depths],
        float(every.min()) * 0.98,
        float(every.max()) * 1.02,
    )


def view(place: tuple[int, int]) -> int:
    """The number in the files' names of the view at (column, row)."""
    return place[1] * GRID + place[0]


def read_image(folder: Path, place: tuple[int, int]) -> Tensor:
    """[3, H, W] in [0, 1]: linear light to the power of 1/2.2."""
    linear = read_exr(folder / f"frame_rgb{view(place):04}.exr", ("R", "G", "B"))
    return linear.abs().pow(1 / 2.2).clamp(max=1)


def read_depth(folder: Path, place: tuple[int, int]) -> Tensor:
    """[H, W] in metres."""
    path = folder / f"frame_depth{view(place):04}.exr"
    depth = read_exr(path, None)[0]
    if not bool((depth > 0).all()):
        raise ValueError(f"{path}: depths that are not positive; expected metres")
    return depth


def read_exr(path: Path, names: tuple[str, ...] | None) -> Tensor:
    """Channels [C, H, W] float32 of these names, or, without names, the first that the file has of R, Y, Z, G and B."""
    try:
        import OpenEXR
    except ModuleNotFoundError:
        raise ModuleNotFoundError(f"{path}: reading it needs the package OpenEXR: make setup-evaluation") from None
    if not path.is_file():
        raise ValueError(f"{path} is missing; expected a view of DeepFocus")
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except RuntimeError as error:
        raise ValueError(f"{path}: {error}; expected an OpenEXR picture") from error
    wanted = names or next(((name,) for name in "RYZGB" if name in channels), ())
    if not wanted or not all(name in channels for name in wanted):
        raise ValueError(f"{path}: channels {', '.join(channels)}; expected {', '.join(names or ('R or Y or Z',))}")
    return torch.stack([torch.from_numpy(channels[name]).float() for name in wanted])


@cache
def find_grid(folder: Path) -> Grid:
    """The data set's cameras, from the views of one scene around its middle."""
    middle, depth = read_image(folder, (MIDDLE, MIDDLE)), read_depth(folder, (MIDDLE, MIDDLE))
    found = []
    for axis in (0, 1):
        others = {}
        for step in (1, 2, 4):
            place = [MIDDLE, MIDDLE]
            place[axis] += step
            others[step] = read_image(folder, tuple(place))
        found.append(fit_axis(folder, middle, depth, others, axis))
    return Grid(*zip(*found, strict=True))


def fit_axis(folder: Path, middle: Tensor, depth: Tensor, others: dict[int, Tensor], axis: int) -> tuple[float, float]:
    """(parallax, shift) of an axis. Searched as the movements, in pixels, of the nearest and the farthest percent of
    the depths from a view to the next; from step to step farther, over which they are seen the finer."""
    near, far = (1 / float(depth.flatten().quantile(q)) for q in (0.01, 0.99))
    share = (1 / depth - far) / max(near - far, 1e-9)  # 1 at the nearest, 0 at the farthest
    best, spacing, reach = (0.0, 0.0), 0.5, 16
    for step, other in others.items():
        offsets = [i * spacing for i in range(-reach, reach + 1)]
        candidates = [(best[0] + a, best[1] + b) for a in offsets for b in offsets]
        errors = [carried_error(middle, other, step * (b + (a - b) * share), axis) for a, b in candidates]
        best = candidates[min(range(len(errors)), key=errors.__getitem__)]
        spacing, reach = spacing / 4, 6
    still = carried_error(middle, other, torch.zeros_like(share), axis)
    if min(errors) > WORST_FIT * still:
        raise ValueError(
            f"{folder}: the cameras were not found: views carried by their depth differ by {min(errors):.4f}, "
            f"as they are by {still:.4f}; expected parallel cameras on a grid, and depths in metres along the axis"
        )
    parallax = (best[0] - best[1]) / max(near - far, 1e-9)
    return parallax, parallax * far - best[1]


def carried_error(middle: Tensor, other: Tensor, movement: Tensor, axis: int) -> float:
    """Mean difference of the middle view's pixels from those that they move to, `movement` [H, W] pixels towards lower
    coordinates; pixels that are hidden or outside count 0.1 at most."""
    height, width = movement.shape
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    moved = (x - movement, y) if axis == 0 else (x, y - movement)
    grid = torch.stack([moved[0] / width * 2 - 1, moved[1] / height * 2 - 1], -1)
    sampled = F.grid_sample(other[None], grid[None], align_corners=False)[0]
    return float((sampled - middle).abs().mean(0).clamp(max=0.1).mean())
