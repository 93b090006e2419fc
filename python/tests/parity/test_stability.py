"""The 50-digit formulas against the float64 reference, and the report of errors."""

import numpy as np
import pytest
import torch

from liveview_ref.parity import fifty_digits, stability
from liveview_ref.reference.composite import composite
from liveview_ref.reference.render.blend import blend
from liveview_ref.reference.render.composite_competing import composite_competing
from liveview_ref.reference.warp import warp_maps
from liveview_ref.rig_arrays import cameras_of, images_of

PIXELS = 6


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def test_warp_in_50_digits_equals_the_reference(rng):
    data = {f"{name}.rotation": np.eye(3) for name in ("view0", "target")}
    data |= {"view0.translation": np.array([0.1, -0.2, 0.3]), "target.translation": np.zeros(3)}
    data |= {f"{name}.k": np.array([[9.0, 0.5, 4], [0, 8, 3], [0, 0, 1]]) for name in ("view0", "target")}
    data |= {"view0.image": rng.random((6, 8, 3)).astype(np.float32), "target.size": np.array([7, 5])}
    data |= {"disparities": np.array([0.75])}
    (source,), target = cameras_of(data)
    (image,) = images_of(data, torch.float64)
    colour, coverage = warp_maps(image, source, target, torch.full((1, 5, 7), 0.75, dtype=torch.float64))
    found = torch.cat([colour[0], coverage])
    digits = np.array([fifty_digits.warp(data, pixel) for pixel in range(35)], dtype=np.float64)
    assert np.abs(found.flatten(1).T.numpy() - digits).max() < 1e-12
    assert 0 < digits[:, 3].sum() < 35  # some pixels are covered by the source, some are not


def test_competing_layers_in_50_digits_equal_the_reference(rng):
    data = {"logits": rng.normal(0, 3, (5, PIXELS)), "rgb": rng.random((5, 3, PIXELS)), "maps": rng.random((5, PIXELS))}
    data = {name: values.astype(np.float32) for name, values in data.items()}
    data |= {"covered": (rng.random((5, PIXELS)) > 0.3).astype(np.uint8), "alpha_scale": np.array([2.0])}
    data["covered"][:, 0] = 0
    data["logits"][:2, 1], data["covered"][:, 1] = (np.inf, -np.inf), 1
    logits, rgb, maps = (torch.from_numpy(data[x]).double()[..., None, :] for x in ("logits", "rgb", "maps"))
    out = composite_competing(logits, rgb, torch.from_numpy(data["covered"] > 0)[:, None], maps, 2.0)
    found = torch.cat([out.rgb, out.disparity[None], out.transmittance[None]]).flatten(1).T.numpy()
    digits = np.array([fifty_digits.composite_competing(data, pixel) for pixel in range(PIXELS)], dtype=np.float64)
    assert np.abs(found - digits).max() < 1e-12
    assert (digits[0] == [0, 0, 0, 0, 1]).all()


def test_blend_in_50_digits_equals_the_reference(rng):
    data = {"logits": rng.normal(0, 3, (3, PIXELS)), "colour": rng.random((9, PIXELS))}
    data |= {"coverage": (rng.random((3, PIXELS)) > 0.4) * rng.random((3, PIXELS)), "distances": np.array([0, 1, 5.0])}
    data = {name: value if name == "distances" else value.astype(np.float32) for name, value in data.items()}
    data["coverage"][:, 0] = 0
    data["logits"][1, 1] = np.inf
    logits, colour, coverage = (
        torch.from_numpy(data[x]).double()[None, :, None] for x in ("logits", "colour", "coverage")
    )
    alpha, rgb = blend(logits, colour.unflatten(1, (3, 3)), coverage, torch.from_numpy(data["distances"]))
    found = torch.cat([alpha, rgb[0]]).flatten(1).T.numpy()
    digits = np.array([fifty_digits.blend(data, pixel) for pixel in range(PIXELS)], dtype=np.float64)
    assert np.abs(found - digits).max() < 1e-12


def test_composite_in_50_digits_equals_the_reference(rng):
    data = {"alpha": rng.random((4, PIXELS)), "maps": rng.random((4, PIXELS)), "rgb": rng.random((4, 3, PIXELS))}
    for background in (True, False):
        data["background"] = np.array([background])
        alpha, rgb, maps = (torch.from_numpy(data[name])[..., None, :] for name in ("alpha", "rgb", "maps"))
        out = composite(alpha, rgb, torch.full((1, PIXELS), background), maps)
        found = torch.cat([out.rgb[:, 0], out.disparity, out.transmittance]).T.numpy()
        digits = np.array([fifty_digits.composite(data, pixel) for pixel in range(PIXELS)], dtype=np.float64)
        assert np.abs(found - digits).max() < 1e-14


def test_errors_leave_out_doubtful_pixels_and_report_non_finite_values():
    data = {"doubtful": np.array([False, True, True]), "truth.rgb": np.zeros(6), "scale.rgb": np.ones(1)}
    found = np.array([[0.1, 9, 0], [0.2, 0, 0]])
    assert stability.errors({"rgb": found}, data, 1e-3) == {"largest": 0.2, "doubtful": 0.5}
    found[0, 1] = np.nan
    assert stability.errors({"rgb": found}, data, 1e-3)["largest"] is None
