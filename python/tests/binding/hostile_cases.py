"""Good arguments of every function of the binding, and ways to spoil them."""

from types import SimpleNamespace

import numpy as np

H, W = 24, 32
NAN = float("nan")


def f32(*shape: int, value: float = 0.5) -> np.ndarray:
    return np.full(shape, value, np.float32)


class Broken:
    def __array__(self, *_args, **_options):
        raise OSError("broken")


class Cases:
    """Good arguments of a small rig, and calls with some of them replaced."""

    def __init__(self, lv):
        self.lv = lv
        self.k = np.array([[30.0, 0, 16], [0, 30, 12], [0, 0, 1]])
        self.poses = np.stack([np.eye(4)] * 5)
        self.poses[:, 0, 3] = np.arange(5) * 0.1
        self.photos = np.random.default_rng(3).integers(0, 255, (5, H, W, 3), dtype=np.uint8)
        self.camera = lv.Camera(self.k, np.eye(4), W, H)
        image = f32(3, H, W)
        depth = lv.PhotoDisparity(f32(H, W), 0.01)
        self.view = SimpleNamespace(image=image, camera=self.camera, confirmed=depth, gains=np.ones(3))
        self.good = {
            "camera": {"k": self.k, "pose": np.eye(4), "width": W, "height": H},
            "scene": {"photos": self.photos, "k": self.k, "poses": self.poses},
            "synthesizer": {"scene": lv.Scene.from_arrays(self.photos, self.k, self.poses), "near": 1, "far": 9},
            "live": {"cameras": [self.camera] * 2, "near": 1, "far": 9},
            "warp_maps": {"image": image, "source": self.camera, "target": self.camera, "maps": f32(2, H, W)},
            "blend": {
                "logits": f32(2, 4, H, W),
                "colour": f32(2, 4, 3, H, W),
                "coverage": f32(2, 4, H, W),
                "distances": np.ones(4),
            },
            "composite": {
                "alpha": f32(2, H, W),
                "rgb": f32(2, 3, H, W),
                "covered": np.ones((H, W), bool),
                "maps": f32(2, H, W),
            },
            "composite_competing": {
                "logit": f32(2, H, W),
                "rgb": f32(2, 3, H, W),
                "covered": np.ones((2, H, W), bool),
                "maps": f32(2, H, W),
            },
            "agreement_logits": {"colour": f32(2, 4, 3, H, W), "coverage": f32(2, 4, H, W)},
            "sharpened": {"image": image, "amount": 0.1},
            "uniform_disparities": {"near": 1, "far": 9, "count": 4},
            "plane_histogram": {"alpha": f32(4, H, W)},
            "select_planes": {"histogram": [4, 0, 2], "count": 2},
            "cover_planes": {"histogram": [4, 0, 2], "count": 2},
            "guided_search": {
                "views": [image] * 2,
                "cameras": [self.camera] * 2,
                "target": self.camera,
                "near": 1,
                "far": 9,
            },
            "choose_views": {"cameras": [self.camera], "target": self.camera, "count": 1},
            "psnr": {"image": image, "truth": image},
            "ssim": {"image": image, "truth": image},
            "photo_depth": {
                "photo": (image, self.camera),
                "neighbours": [(image, self.camera)],
                "near": 1,
                "far": 9,
            },
            "confirmed": {"which": 0, "maps": [(self.camera, depth)] * 2},
            "visible": {
                "camera": self.camera,
                "confirmed": f32(H, W),
                "target": self.camera,
                "disparity": f32(H, W),
                "margin": 0.1,
            },
            "surface": {"views": [self.view], "target": self.camera, "near": 1, "far": 9},
            "surface_layers": {"disparity": f32(H, W), "count": 3},
            "exposure_gains": {"views": [self.view], "distances": [1.0]},
            "fill_holes": {"map_": f32(H, W)},
            "median3": {"x": f32(H, W)},
        }
        self.good["guided_layers"] = self.good["guided_search"] | {"count": 2}
        self.good["anchored_depth"] = self.good["photo_depth"]
        self.good["visible_or_past"] = self.good["visible"]
        self.good["sharpening"] = {"views": [self.view]}
        self.good["view_distances"] = {"cameras": [self.camera], "target": self.camera}

    def call(self, name: str, **changed):
        arguments = self.good[name] | changed
        if name == "camera":
            return self.lv.Camera(**arguments)
        if name == "scene":
            return self.lv.Scene.from_arrays(**arguments)
        if name == "synthesizer":
            return self.lv.Synthesizer(**arguments)
        if name == "live":
            return self.lv.LiveSession(**arguments)
        if name == "surface_layers":
            return self.lv.Surface(arguments["disparity"], 0.1, 0.0).layers(arguments["count"])
        return getattr(self.lv, name)(**arguments)

    def pose(self, row: int, column: int, value: float) -> np.ndarray:
        poses = self.poses.copy()
        poses[2, row, column] = value
        return poses

    def seen(self, **changed) -> list[SimpleNamespace]:
        return [SimpleNamespace(**(vars(self.view) | changed))]

    def k_with(self, row: int, column: int, value: float) -> np.ndarray:
        k = self.k.copy()
        k[row, column] = value
        return k


def with_value(array: np.ndarray, value: float) -> np.ndarray:
    array = array.copy()
    array.flat[7] = value
    return array


def vars_of(camera, **changed) -> dict:
    return {name: getattr(camera, name) for name in ("k", "rotation", "translation", "width", "height")} | changed
