"""Writes parity/goldens: small cases of every stage, from the float64 reference, that `cargo test`
compares the runtime with (tests/goldens.rs), so that Rust alone suffices to check it.

Photos are 8-bit, as in files; other inputs are float32 numbers of few digits; expected values are
rounded to float32, except for disparities of planes (float64). `make goldens` runs it.
"""

import json
import math
import sys
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..checkpoint import load_network
from ..paths import ROOT
from ..reference.competing import best_layer, composite_competing
from ..reference.liveview import (
    Camera,
    Composited,
    PlaneSweep,
    blend,
    composite,
    kornia_samples,
    pixel_centres,
    plane_histogram,
    render,
    select_planes,
    uniform_disparities,
    warp,
)

FOLDER = ROOT / "parity/goldens"
MODEL = "models/liveview_v2.onnx"
COMMENT = "Written by python/liveview_ref/parity/goldens.py (`make goldens`) from the float64 reference."


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for name, cases in goldens().items():
        (folder / f"{name}.json").write_text(text_of(cases))


def goldens() -> dict[str, list[dict]]:
    """The cases of each stage, by the name of their file."""
    stages = [warp_cases, blend_cases, composite_cases, competing_cases, selection_cases]
    stages += [uniform_planes_cases, network_cases, render_cases]
    return {
        stage.__name__.removesuffix("_cases"): stage(np.random.default_rng([2021, index]))
        for index, stage in enumerate(stages)
    }


# --- JSON: arrays flat, in row-major order ---


def text_of(cases: list[dict]) -> str:
    """A file of cases, with an entry a line."""
    entries = (
        ",\n".join(f'  "{key}": {json.dumps(value, separators=(",", ":"))}' for key, value in case.items())
        for case in cases
    )
    return f'{{"comment": "{COMMENT}", "cases": [\n' + ",\n".join(f"{{\n{text}\n}}" for text in entries) + "\n]}\n"


def numbers(values: Tensor | np.ndarray) -> list[float] | list[int]:
    """The numbers of an array; float32 by the shortest text that reads back as the same number."""
    flat = np.asarray(values).ravel()
    if np.issubdtype(flat.dtype, np.floating):
        return [float(str(value)) for value in flat.astype(np.float32)]
    return flat.astype(int).tolist()


def numbered(**arrays: Tensor | np.ndarray) -> dict[str, list[float] | list[int]]:
    """The numbers of each array."""
    return {name: numbers(values) for name, values in arrays.items()}


def expected(found: Composited, best: Tensor) -> dict[str, list[float] | list[int]]:
    """What a composite gives, and the best layer of each pixel."""
    values = {"rgb": found.rgb, "disparity": found.disparity, "transmittance": found.transmittance, "best": best}
    return numbered(**{f"expected_{name}": value for name, value in values.items()})


def exact(values: Tensor) -> list[float]:
    """Float64 numbers, by their shortest text."""
    return values.flatten().tolist()


def camera_entry(camera: Camera) -> dict:
    pose = torch.cat([camera.rotation, camera.translation[:, None]], 1)
    return {"k": camera.k.tolist(), "pose": pose.tolist(), "size": [camera.width, camera.height]}


# --- inputs ---


def turned(angles: np.ndarray) -> np.ndarray:
    """The rotation matrix of an axis times an angle in radians."""
    x, y, z = angles
    return torch.linalg.matrix_exp(torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=torch.float64)).numpy()


def inputs(values: np.ndarray) -> Tensor:
    """Float32 numbers as the reference's float64."""
    return torch.from_numpy(np.asarray(values).astype(np.float32).astype(np.float64))


def photo(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """Smooth waves with some noise, [h, w, 3] uint8."""
    y, x = np.mgrid[:height, :width]
    waves = [np.sin(rng.uniform(0, 0.6) * x + rng.uniform(0, 0.6) * y + rng.uniform(0, 6)) for _ in range(3)]
    values = 0.5 + 0.4 * np.stack(waves, -1) + rng.normal(0, 0.04, (height, width, 3))
    return np.clip(np.round(255 * values), 0, 255).astype(np.uint8)


def photo_of_walls(camera: Camera) -> np.ndarray:
    """What a camera near the origin sees of a wall at z = 1.3, x < 0, before another at z = 4,
    [h, w, 3] uint8."""
    rays = torch.tensordot(
        camera.rotation.T @ torch.linalg.inv(camera.k), pixel_centres(camera.height, camera.width), 1
    )
    centre = camera.centre[:, None, None]
    walls = []
    for z in (1.3, 4.0):
        x, y, _ = centre + rays * (z - centre[2]) / rays[2]
        # Waves of some six pixels.
        walls.append(
            (x, torch.stack([torch.sin(a * x / z) + torch.cos(b * y / z) for a, b in [(22, 9), (15, 21), (8, 25)]], -1))
        )
    (x, near), (_, far) = walls
    values = 0.5 + 0.2 * torch.where((x < 0)[..., None], near, far)
    return (255 * values).round().to(torch.uint8).numpy()


def colours(picture: np.ndarray) -> Tensor:
    """[h, w, 3] uint8 -> [3, h, w] in [0, 1], as the float32 quotient."""
    return inputs(picture.astype(np.float32) / np.float32(255)).permute(2, 0, 1)


def camera(k: list[float], turn: list[float], centre: list[float], width: int, height: int) -> Camera:
    """From fx, skew, cx, fy, cy; the rotation as an axis times radians; and the centre."""
    fx, skew, cx, fy, cy = k
    rotation = torch.from_numpy(turned(np.array(turn)))
    matrix = torch.tensor([[fx, skew, cx], [0, fy, cy], [0, 0, 1]], dtype=torch.float64)
    return Camera(matrix, rotation, -rotation @ torch.tensor(centre, dtype=torch.float64), width, height)


# --- the stages ---


def warp_cases(rng: np.random.Generator) -> list[dict]:
    level = [0.0, 0.0, 0.0]
    small = camera([18, 0, 8, 18, 4], level, level, 16, 8)
    wide = camera([60, 0.4, 35, 58, 4.5], [0.02, -0.03, 0.01], [0.1, 0, 0], 72, 8)
    # A width of 72 is more than a run of 64 pixels.
    general = camera([30, 0.3, 19.2, 31, 7.1], [0.05, 0.04, -0.08], [0.3, -0.1, 0.05], 40, 14)
    aside = camera([6, 0, 9, 6, 5], [0.1, 1.0, 0], [-0.4, 0.1, 1], 18, 10)
    turned_back = camera([6, 0, 9, 6, 5], [0.1, 2.2, 0], [0.4, 0.1, 1], 18, 10)
    beside = camera([18, 0, 8, 18, 4], level, [0.25, -0.125, 0], 16, 8)
    # Without rotation a run of a plane moves by one fraction of a pixel, which Rust computes once.
    level_rig = [
        camera([60, 0, 40, 60, 4.5], level, [0.045, -0.06, 0], 80, 9),
        camera([60, 0, 32, 60, 4], level, level, 64, 8),
    ]
    cases = [
        ("cameras without rotation", *level_rig, [1.0]),
        ("general cameras", general, wide, [1.5]),
        ("disparity 0", camera([20, 0, 8, 20, 5], [0.05, -0.1, 0.1], [5, 4, 3], 16, 10), small, [0.0]),
        ("most points behind the camera", aside, small, [0.9]),
        ("some points behind the camera", turned_back, small, [0.9]),
        ("the photo's edge", beside, small, [1.1]),
    ]
    return [warp_case(rng, *case) for case in cases]


def warp_case(rng: np.random.Generator, name: str, source: Camera, target: Camera, disparities: list[float]) -> dict:
    picture = photo(rng, source.width, source.height)
    planes = [warp(colours(picture), source, target, disparity) for disparity in disparities]
    colour, coverage = (torch.stack([plane[i] for plane in planes]) for i in (0, 1))
    assert coverage.shape[1:] == (target.height, target.width), "no padding"
    inside, outside = coverage > 1 - 1e-9, coverage == 0
    assert bool(inside.any() and outside.any() and (~inside & ~outside).any()), f"{name}: inside, outside and edge"
    if "behind" in name:
        homography = PlaneSweep.of(source, target).source_from_target(disparities[0])
        behind = torch.tensordot(homography[2], pixel_centres(*coverage.shape[1:]), 1) <= 0
        ghost = kornia_samples(colours(picture), source, target, disparities[0], tuple(coverage.shape[1:]))
        assert bool((ghost[3] * behind).any()), "a mirrored photo shows where points behind the camera are not masked"
    cameras = {"source": camera_entry(source), "target": camera_entry(target)}
    arrays = numbered(photo=picture, colour=colour, coverage=coverage)
    return {"name": name, **cameras, "disparities": disparities, **arrays}


def blend_cases(rng: np.random.Generator) -> list[dict]:
    coverage = rng.choice([0, 0.25, 0.7, 1, 1], (3, 136))  # 136 pixels: Rust computes 128 together
    coverage[:, :3] = 0
    logits = np.round(rng.normal(0, 2, coverage.shape), 2)
    seen = rng.choice([0, 1, 1], (3, 24))
    extreme = rng.choice([-3e38, -1e4, -90, 0, 90, 1e4, 3e38], (3, 40))
    # Not with logits of 1e9 and more: in float32 these lose a distance of this size.
    far = rng.choice([-1e4, -90, 0, 90, 1e4], (3, 16))
    return [
        blend_case(rng, "coverage", [0.11, 0.2, 0.55], logits, coverage),
        blend_case(rng, "a coincident view", [0, 0.5, 0.9], np.round(rng.normal(0, 2, seen.shape), 2), seen),
        blend_case(rng, "extreme logits", [0.2, 0.3, 0.5], extreme, rng.choice([0, 1, 1], extreme.shape)),
        blend_case(rng, "extreme distances", [1e-30, 0.5, 1e30], far, rng.choice([0, 1], far.shape)),
    ]


def blend_case(
    rng: np.random.Generator, name: str, distances: list[float], logits: np.ndarray, coverage: np.ndarray
) -> dict:
    colour = np.round(rng.uniform(0, 1, (len(logits), 3, logits.shape[1])) * coverage[:, None], 2)
    as_row = (inputs(logits)[None, :, None], inputs(colour)[None, :, :, None], inputs(coverage)[None, :, None])
    alpha, rgb = blend(*as_row, torch.tensor(distances, dtype=torch.float64))
    arrays = numbered(logits=logits, colour=colour, coverage=coverage, alpha=alpha, rgb=rgb)
    return {"name": name, "distances": distances, **arrays}


def layers_of(rng: np.random.Generator, planes: int, pixels: int) -> tuple[Tensor, Tensor]:
    """Disparities near -> far, the last at infinity, and colours [planes, 3, 1, pixels]."""
    disparities = np.linspace(1, 0, planes) ** 1.5
    return inputs(np.round(disparities, 3)), inputs(np.round(rng.uniform(0, 1, (planes, 3, 1, pixels)), 2))


def composite_cases(rng: np.random.Generator) -> list[dict]:
    alphas = np.round(rng.beta(0.4, 0.7, (6, 40)), 2)  # many are near 0 and near 1
    alphas[:, 0], alphas[2, 1], alphas[:, 2] = 0, 1, 0.5
    cases = []
    for name, alpha in [("six planes", alphas), ("one plane", alphas[:1, :12])]:
        planes, pixels = alpha.shape
        disparities, rgb = layers_of(rng, planes, pixels)
        covered = rng.choice([False, True], (1, pixels))
        opaque = inputs(alpha)[:, None]
        found = composite(opaque, rgb, torch.from_numpy(covered), disparities[:, None, None])
        best = torch.where(opaque.amax(0) > 0, opaque.argmax(0), -1)
        given = numbered(disparities=disparities, alpha=alpha, rgb=rgb, last_covered=covered)
        cases.append({"name": name, **given, **expected(found, best)})
    return cases


def competing_cases(rng: np.random.Generator) -> list[dict]:
    ordinary = np.round(rng.normal(0, 2, (6, 40)), 2)
    ordinary[3, :4] = ordinary[1, :4]  # ties
    extreme = rng.choice([-3e38, -700, -1, 0, 1, 700, 3e38], (6, 24))
    cases = []
    for name, logits, scale in [
        ("scale 1", ordinary, 1.0),
        ("scale 2", ordinary[:, :20], 2.0),
        ("extreme", extreme, 4.0),
    ]:
        planes, pixels = logits.shape
        disparities, rgb = layers_of(rng, planes, pixels)
        covered = torch.from_numpy(rng.choice([False, True, True], (planes, 1, pixels)))
        covered[:, :, :2] = False
        logit = inputs(logits)[:, None]
        found = composite_competing(logit, rgb, covered, disparities[:, None, None], scale)
        given = numbered(disparities=disparities, logits=logits, rgb=rgb, covered=covered)
        cases.append({"name": name, "scale": scale, **given, **expected(found, best_layer(logit, covered))})
    return cases


def selection_cases(rng: np.random.Generator) -> list[dict]:
    cases = []
    for name, planes, pixels in [("twelve planes", 12, 60), ("ties", 8, 9)]:
        alpha = np.round(rng.beta(0.5, 1, (planes, pixels)), 1)  # a digit: pixels with equal alphas
        alpha[:, :3] = 0
        histogram = plane_histogram(inputs(alpha)[:, None])
        assert len(set(histogram.tolist())) < planes, "bins of equal height"
        chosen = {str(count): select_planes(histogram, count) for count in (1, 3, 4, planes - 1, planes + 5)}
        cases.append({"name": name, "alpha": numbers(alpha), "histogram": numbers(histogram), "chosen": chosen})
    return cases


def uniform_planes_cases(_rng: np.random.Generator) -> list[dict]:
    ranges = [(1.2, 7.3, 64), (0.7, math.inf, 16), (0.5, 2.0, 1), (3.0, math.inf, 1), (1e-3, 1e5, 5)]
    return [
        {
            "name": f"{count} from {near} to {far}",
            "near": near,
            "far": None if math.isinf(far) else far,  # JSON has no infinity
            "count": count,
            "disparities": exact(uniform_disparities(near, far, count)),
        }
        for near, far, count in ranges
    ]


def network_cases(rng: np.random.Generator) -> list[dict]:
    hwv = torch.cat([colours(photo(rng, 32, 32)) for _ in range(2)])[None]
    hwv[:, 3:, :, 24:] = 0  # what the second view does not see
    with torch.inference_mode():
        logits = load_network(ROOT / MODEL).double()(hwv)
    bytes_of = (hwv * 255).round().int()
    return [{"name": MODEL, "model": MODEL, "side": 32, "hwv": numbers(bytes_of), "logits": numbers(logits)}]


def render_cases(_rng: np.random.Generator) -> list[dict]:
    width, height = 21, 19  # padded to 24 x 24
    target = camera([22, 0, 10.5, 22, 9.5], [0.02, 0.03, 0], [0, 0, 0], width, height)
    cameras = [
        camera([32, 0, 13, 32, 11], [0.0, 0.05, 0.02], [0.15, 0.05, 0], 26, 22),
        camera([29, 0, 12.5, 31, 11.5], [0.04, -0.04, 0], [-0.3, 0.1, 0.05], 26, 22),
    ]
    pictures = [photo_of_walls(camera) for camera in cameras]
    disparities = uniform_disparities(1.3, 4.0, 3)
    with torch.inference_mode():
        network = load_network(ROOT / MODEL).double()
        found, stages = render(network, [colours(picture) for picture in pictures], cameras, target, disparities)
    alpha = stages.alpha[:, :height, :width]
    best = torch.where(alpha.amax(0) > 0, alpha.argmax(0), -1)
    assert {-1, 0, 2} <= set(best.unique().tolist()), "both walls show, and some pixels are uncovered"
    first, second, _ = alpha.float().sort(0, descending=True)[0]
    assert float((first - second)[best >= 0].min()) > 1e-5, "the best plane is no matter of rounding"
    return [
        {
            "name": "the paper's picture",
            "model": MODEL,
            "target": camera_entry(target),
            "sources": [camera_entry(camera) for camera in cameras],
            "photos": [numbers(picture) for picture in pictures],
            "disparities": exact(disparities),
            "largest_logit": float(stages.logits.abs().max()),
            **numbered(rgb=found.rgb, disparity=found.disparity, transmittance=found.transmittance, best=best),
        }
    ]


if __name__ == "__main__":
    main()
