"""New views of a scene from a few posed photos, on numpy arrays.

Conventions: camera axes are OpenCV's (x right, y down, z forward); K is in pixels, and the centre
of the pixel in column i, row j is (i + 0.5, j + 0.5); disparity is 1/z in 1/scene unit, 0 at
infinity; layers are ordered near to far; colours are sRGB values in [0, 1].

Arguments are numpy arrays of any strides, or what numpy makes arrays of, such as torch tensors on
the CPU; they are never written to, and must not change during a call. A wrong type raises
TypeError, a wrong shape or value ValueError, with the argument's name; what the library refuses
raises `Error`. Other Python threads run on during a call. Ctrl-C ends a search of depth after the
current photo, and the network at once."""

from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from typing import Literal, Protocol, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike

from ._tuples import Composited, PhotoDisparity, RangeMap, Surface, ViewDepth

Convention = Literal["opencv", "opengl"]

class CameraLike(Protocol):
    """A `Camera`, or any object with its fields, such as the reference's: k [3, 3]; rotation [3, 3]
    and translation [3] of cam_from_world; width, height."""

    @property
    def k(self) -> ArrayLike: ...
    @property
    def rotation(self) -> ArrayLike: ...
    @property
    def translation(self) -> ArrayLike: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...

class Error(RuntimeError):
    """What the library refuses or cannot do: a scene, a model, a target. The text is the
    library's."""

class Camera:
    """A pinhole camera. Always valid: a K without an inverse, a matrix that is not a rotation and
    numbers that are not finite are refused.

    k [3, 3] in pixels; pose [4, 4] in scene units: "opencv": cam_from_world, x right, y down, z
    forward; "opengl": world_from_cam, x right, y up, z backwards, as nerfstudio and Blender have
    it."""

    def __init__(
        self, k: ArrayLike, pose: ArrayLike, width: int, height: int, *, convention: Convention = "opencv"
    ) -> None: ...
    @property
    def k(self) -> np.ndarray:
        """[3, 3] float64, pixels."""
    @property
    def rotation(self) -> np.ndarray:
        """R of cam_from_world, [3, 3] float64."""
    @property
    def translation(self) -> np.ndarray:
        """t of cam_from_world, [3] float64, scene units."""
    @property
    def centre(self) -> np.ndarray:
        """The camera's centre in the world, [3] float64, scene units."""
    @property
    def width(self) -> int:
        """Pixels."""
    @property
    def height(self) -> int:
        """Pixels."""
    def pose(self, convention: Convention = "opencv") -> np.ndarray:
        """[4, 4] float64, as the constructor takes it."""
    def with_pose(self, pose: ArrayLike, *, convention: Convention = "opencv") -> Camera:
        """The same camera with another pose [4, 4]."""
    def with_size_scaled(self, width: int, height: int) -> Camera:
        """The same camera for its picture resampled to that size, pixels."""

class Scene:
    """Posed photos: from a folder, or by `from_arrays`.

    A folder in one of the formats that the program reads, or a `transforms.json`. Photos wider than
    `width` pixels are scaled down to it, by default those of more than 2.4 megapixels to that;
    `images` names the photos' folder, `format` one of several formats in it; `exif_rotate` turns
    photos by their EXIF orientation."""

    def __init__(
        self,
        path: str | PathLike[str],
        *,
        width: int | None = None,
        images: str | None = None,
        format: str | None = None,
        exif_rotate: bool = False,
    ) -> None: ...
    @staticmethod
    def from_arrays(
        photos: ArrayLike | Sequence[ArrayLike],
        k: ArrayLike,
        poses: ArrayLike,
        *,
        convention: Convention = "opencv",
        names: Sequence[str] | None = None,
    ) -> Scene:
        """photos [n, h, w, 3], uint8 or float32 in [0, 1], or a list of [h, w, 3] of several sizes;
        k [3, 3] or [n, 3, 3]; poses [n, 4, 4], as `Camera` takes them. Views are in the order of
        their names, which are 0000, 0001 … by default."""
    @property
    def names(self) -> list[str]:
        """Of the views, in order."""
    @property
    def cameras(self) -> list[Camera]:
        """Of the views, in order."""
    @property
    def depth_ranges(self) -> list[tuple[float, float] | None]:
        """Nearest and farthest depth of each view, scene units, where the scene's files give it."""
    @property
    def notes(self) -> list[str]:
        """What was skipped or assumed when the scene was opened."""
    def photo(self, view: str | SupportsIndex) -> np.ndarray:
        """The photo of a view, undistorted, at the size of its camera: [h, w, 3] float32 in [0,
        1]."""
    def path(self, path: str) -> list[Camera]:
        """The cameras of a path around the views, as `render --path` takes it: "spiral:30"."""
    def __len__(self) -> int: ...

class Synthesizer:
    """Renders new views of a scene. Photos and their depth are kept from picture to picture.
    Several threads may share one: their pictures are made one after the other.

    `views`: photos to a picture, the network's number or 4 by default. `layers`: such as
    "surface:3" or "planes:64"; the network's or "surface:3" by default. `network`: a model file
    (.onnx); None weights photos by their agreement. ONNX Runtime is that of `ORT_DYLIB_PATH`, else
    of the installed package onnxruntime. `near`, `far`: depth range, scene units, by default the
    scene's. `cache`: a folder that keeps the depth of photos. `progress(done, count, name)` is
    called before each search of a photo's depth; its exception ends the search."""

    def __init__(
        self,
        scene: Scene,
        *,
        views: int | None = None,
        layers: str | None = None,
        network: str | PathLike[str] | None = None,
        near: float | None = None,
        far: float | None = None,
        cache: str | PathLike[str] | None = None,
        progress: Callable[[int, int, str], object] | None = None,
    ) -> None: ...
    def render(self, target: str | SupportsIndex | CameraLike) -> Frame:
        """The picture of a camera, or of a view of the scene (its name or index), rendered from the
        others."""
    def render_path(self, targets: Sequence[CameraLike]) -> Frames:
        """The pictures of cameras along a path, one after the other, over one depth range."""
    def depth(self, photo: str | SupportsIndex) -> ViewDepth:
        """The depth of a view's photo, searched among its neighbours. Depths that views
        not yet asked for need stay in memory, others within 128 MiB."""
    @property
    def scene(self) -> Scene:
        """The scene."""
    @property
    def layers(self) -> str:
        """The layers it renders on."""
    @property
    def views(self) -> int:
        """Photos to a picture."""

class Network:
    """The network of a model file (.onnx): called with warped photos hwv [n, 3V, h, w] in [0, 1],
    it returns logits [n, V, h, w]; h and w are multiples of 8. `threads`: one per core by default.
    ONNX Runtime as for `Synthesizer`. A run is not ended by Ctrl-C."""

    def __init__(self, path: str | PathLike[str], *, threads: int | None = None) -> None: ...
    def __call__(self, hwv: ArrayLike) -> np.ndarray: ...
    @property
    def views(self) -> int:
        """V, photos to a picture."""

class LiveSession:
    """Renders the time steps of a rig of cameras, one after the other. What one has found the next
    reuses: the depth of a photo where it stays the same, or the planes that were selected.

    `near`, `far`: depth range, scene units. `views`, `layers`, `network`: as of `Synthesizer`.
    `policy`: when layers are searched: "propagate", where the photos have changed; "each" step;
    "once". By default "propagate", and "once" for planes."""

    def __init__(
        self,
        cameras: Sequence[CameraLike],
        near: float,
        far: float,
        *,
        views: int | None = None,
        layers: str | None = None,
        network: str | PathLike[str] | None = None,
        policy: str | None = None,
    ) -> None: ...
    def render(self, photos: ArrayLike | Sequence[ArrayLike | None], target: CameraLike) -> Frame:
        """The picture of a camera at the next time step; photos: of each camera in order [h, w, 3],
        as `Scene.from_arrays` takes them, or None where it has delivered nothing."""
    def restart(self) -> None:
        """Forgets what earlier steps have found: the next is rendered like the first."""

class Frames(Iterator[Frame]):
    """The pictures of a path; each is rendered when it is asked for."""

    def __iter__(self) -> Frames: ...
    def __next__(self) -> Frame: ...
    def __len__(self) -> int: ...
    def __getitem__(self, index: int) -> Frame:
        """Any frame from 0 on, the same as when it is reached one after the other."""

class Frame:
    """A rendered picture. Each read of an array is a copy."""

    @property
    def name(self) -> str:
        """The target's."""
    @property
    def picture(self) -> np.ndarray:
        """[h, w, 3] float32 in [0, 1]; pixels that no photo covers are filled from their
        surroundings."""
    @property
    def raw(self) -> np.ndarray:
        """The picture as it was composited, [h, w, 3] float32; black where no photo covers any
        layer."""
    @property
    def disparity(self) -> np.ndarray:
        """[h, w] float32, 1/scene unit."""
    @property
    def transmittance(self) -> np.ndarray:
        """[h, w] float32: the share of each pixel that no photo covers, in [0, 1]."""
    @property
    def uncovered(self) -> float:
        """The share of the picture that no photo covers."""
    @property
    def guessed(self) -> float | None:
        """The share of the pixels whose surface no two photos confirm; None for layers that do not
        follow it."""
    @property
    def occluded(self) -> float:
        """The share of the pixels that are hidden in every photo, by the photos' own depth."""
    @property
    def times(self) -> dict[str, float]:
        """Seconds of each stage: depth, selection (of a live session photos, layers), warp,
        network, composite."""
    def save(self, path: str | PathLike[str]) -> None:
        """Writes the picture, as `liveview render` does: JPEG for .jpg, else PNG."""

# Stages, with the names and arguments of `liveview_ref.reference`. Arrays are float32.

def warp_maps(
    image: ArrayLike, source: CameraLike, target: CameraLike, maps: ArrayLike, scale: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Warps a photo [3, h, w] by maps of disparity [L, H, W] to colour [L, 3, H, W] and coverage
    [L, H, W]. The photo is at 1/scale of its camera's size, a pixel of the maps is `scale` pixels
    of the target wide."""

def sharpened(image: ArrayLike, amount: float) -> np.ndarray:
    """The photo [3, h, w] plus `amount` times its detail, in [0, 1]."""

def agreement_logits(colour: ArrayLike, coverage: ArrayLike) -> np.ndarray:
    """Logits [L, V, H, W] without a network, of warped colours [L, V, 3, H, W] and their coverage
    [L, V, H, W], 0 where a view does not see the layer."""

def blend(
    logits: ArrayLike, colour: ArrayLike, coverage: ArrayLike, distances: ArrayLike, power: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Opacity [N, H, W] and colour [N, 3, H, W] of layers, of logits [N, V, H, W], colour
    [N, V, 3, H, W], coverage [N, V, H, W] and the views' distances [V] or [N, V], scene units."""

def composite(alpha: ArrayLike, rgb: ArrayLike, covered: ArrayLike, maps: ArrayLike) -> Composited:
    """Front-to-back composite of alpha [L, H, W], rgb [L, 3, H, W] and maps of disparity [L, H, W],
    near to far; covered [H, W] bool: where any view covers the farthest layer, which is opaque
    there."""

def composite_competing(
    logit: ArrayLike, rgb: ArrayLike, covered: ArrayLike, maps: ArrayLike, scale: float = 1.0
) -> Composited:
    """Composite of competing layers: the softmax of `scale` times logit [L, H, W] over the layers
    that cover a pixel, covered [L, H, W] bool; rgb [L, 3, H, W], maps of disparity [L, H, W]."""

def uniform_disparities(near: float, far: float, count: int) -> np.ndarray:
    """[count] float64 disparities evenly spaced from 1/near to 1/far; far may be infinite."""

def plane_histogram(alpha: ArrayLike) -> np.ndarray:
    """Number of pixels of which each plane is the most opaque, [D] int64, of alpha [D, H, W]."""

def select_planes(histogram: ArrayLike, count: int) -> list[int]:
    """Indices of the `count` fullest bins, near to far."""

def cover_planes(histogram: ArrayLike, count: int) -> list[int]:
    """Indices, near to far, of the `count` planes that lie nearest to the best planes of all
    pixels."""

def guided_search(
    views: Sequence[ArrayLike],
    cameras: Sequence[CameraLike],
    target: CameraLike,
    near: float,
    far: float,
    planes: int | None = None,
) -> RangeMap:
    """The range of disparities of each cell of 2 x 2 pixels of the padded target, found by a search
    among photos [3, h, w] with `planes` planes, or as many as the parallax asks for."""

def guided_layers(
    views: Sequence[ArrayLike],
    cameras: Sequence[CameraLike],
    target: CameraLike,
    near: float,
    far: float,
    count: int,
    planes: int | None = None,
) -> np.ndarray:
    """`count` guided layers as maps of disparity [count, H, W] over the padded target."""

def bake(
    scene: Scene,
    path: str | PathLike[str],
    *,
    max_mb: float = 8.0,
    held_out: Sequence[str | int] | None = None,
    near: float | None = None,
    far: float | None = None,
) -> list[str]:
    """Writes a scene as one page that opens in any browser, without a server; returns what was left
    out, a line each. `max_mb`: its largest size in millions of bytes. `held_out`: views to compare
    with, by name or index. `near`, `far`: depth range, scene units, by default the scene's."""

def undistort(photo: ArrayLike, k: ArrayLike, distortion: ArrayLike, *, fisheye: bool = False) -> np.ndarray:
    """A photo [h, w, 3] as a pinhole camera with its K shows it, float32; edge pixels are repeated
    where it shows nothing. `distortion`: OpenCV's k1, k2, p1, p2, or with k3, or with k3 to k6 too;
    with `fisheye` its k1 to k4."""

def choose_views(cameras: Sequence[CameraLike], target: CameraLike, count: int, kept: Sequence[int] = ()) -> list[int]:
    """Indices of the `count` cameras to render the target from, nearest first: those that show it,
    from all sides; of those in `kept` (indices) the cost is a tenth lower."""

def view_distances(cameras: Sequence[CameraLike], target: CameraLike) -> np.ndarray:
    """Distances of the cameras' centres to the target's, [V] float64, scene units."""

def psnr(image: ArrayLike, truth: ArrayLike) -> float:
    """Peak signal-to-noise ratio of pictures [3, h, w], dB; infinite for equal ones."""

def ssim(image: ArrayLike, truth: ArrayLike) -> float:
    """Structural similarity of pictures [3, h, w] of at least 11 x 11 pixels."""

def photo_depth(
    photo: tuple[ArrayLike, CameraLike], neighbours: Sequence[tuple[ArrayLike, CameraLike]], near: float, far: float
) -> PhotoDisparity:
    """The depth of a photo, searched from near to far (scene units) among its neighbours; photos
    [3, h, w] in [0, 1] with their cameras."""

def anchored_depth(
    photo: tuple[ArrayLike, CameraLike], neighbours: Sequence[tuple[ArrayLike, CameraLike]], near: float, far: float
) -> PhotoDisparity:
    """As photo_depth, with what the neighbours find at a small size as anchors."""

def confirmed(which: int, maps: Sequence[tuple[CameraLike, PhotoDisparity]]) -> np.ndarray:
    """The pixels [h, w] bool of map `which` that the other maps confirm."""

def visible(
    camera: CameraLike, confirmed: ArrayLike, target: CameraLike, disparity: ArrayLike, margin: float
) -> np.ndarray:
    """1 where a view sees the points of the target's pixels at `disparity` [h, w], 0 where its own
    confirmed disparity [h, w] (-1: none) is nearer by `margin`, 1/scene unit."""

def visible_or_past(
    camera: CameraLike, confirmed: ArrayLike, target: CameraLike, disparity: ArrayLike, margin: float
) -> np.ndarray:
    """As visible, but -1 where the view sees past the point."""

class SurfaceView(Protocol):
    """A photo [3, h, w] in [0, 1], its camera, its confirmed depth and the gains [3] of its
    colours."""

    image: ArrayLike
    camera: CameraLike
    confirmed: PhotoDisparity
    gains: ArrayLike

def surface(views: Sequence[SurfaceView], target: CameraLike, near: float, far: float) -> Surface:
    """The target's surface from the confirmed depth of photos, nearest first."""

def _surface_layers(disparity: ArrayLike, count: int) -> np.ndarray: ...
def exposure_gains(views: Sequence[SurfaceView], distances: ArrayLike) -> np.ndarray:
    """Gains [V, 3] that bring the photos to a common exposure; distances [V] from the target."""

def sharpening(views: Sequence[SurfaceView]) -> np.ndarray:
    """How much to sharpen each photo, [V]."""

def fill_holes(map_: ArrayLike) -> np.ndarray:
    """The map [h, w] with its holes, pixels below 0, filled from their farthest neighbours."""

def median3(x: ArrayLike) -> np.ndarray:
    """3 x 3 median of a map [h, w], edges repeated."""
