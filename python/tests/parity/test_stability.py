"""The 50-digit formulas against the float64 reference, the verdicts of the table, and departures
that it must report."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from liveview_ref.parity import fifty_digits
from liveview_ref.parity.stability.case import Case, Inputs, exponent, units
from liveview_ref.parity.stability.outcome import Errors, Outcome, Truth
from liveview_ref.parity.stability.table import by_case, by_family
from liveview_ref.paths import MODELS, ROOT
from liveview_ref.reference.competing import composite_competing
from liveview_ref.reference.layers import warp_maps
from liveview_ref.reference.liveview import Camera, blend, composite

PIXELS = 6


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def double(*arrays: np.ndarray) -> list[torch.Tensor]:
    """With the pixels in one row, as float64 unless they are flags."""
    tensors = [torch.from_numpy(array)[..., None, :] for array in arrays]
    return [tensor.double() if tensor.is_floating_point() else tensor for tensor in tensors]


def digits_of(function, *arrays: np.ndarray, options=()) -> np.ndarray:
    parts = [[array[..., pixel] for array in arrays] for pixel in range(PIXELS)]
    return np.array([function(*of_pixel, *options) for of_pixel in parts], dtype=np.float64)


def test_warp_in_50_digits_equals_the_reference(rng):
    eye, k = torch.eye(3).double(), torch.tensor([[9, 0.5, 4], [0, 8, 3], [0, 0, 1]]).double()
    source, target = (Camera(k, eye, torch.tensor(t).double(), 7, 5) for t in ([0.1, -0.2, 0.3], [0, 0, 0]))
    photo = rng.random((3, 6, 8)).astype(np.float32)
    maps = torch.full((1, 5, 7), 0.75).double()
    colour, coverage = warp_maps(torch.from_numpy(photo).double(), source, target, maps)
    found = torch.cat([colour[0], coverage])
    digits = [fifty_digits.warp(photo, source, target, 0.75, pixel) for pixel in range(35)]
    assert np.abs(found.flatten(1).T.numpy() - np.array(digits, dtype=np.float64)).max() < 1e-12
    covered = sum(of_pixel[3] for of_pixel in digits)
    assert 0 < covered < 35  # some pixels are covered by the source, some are not


def test_competing_layers_in_50_digits_equal_the_reference(rng):
    logit, rgb, maps = (rng.normal(0.5, 3, shape).astype(np.float32) for shape in ((5, 6), (5, 3, 6), (5, 6)))
    covered = rng.random((5, PIXELS)) > 0.3
    covered[:, 0] = False
    logit[:2, 1], covered[:, 1] = (np.inf, -np.inf), True
    out = composite_competing(*double(logit, rgb, covered, maps), 2.0)
    found = torch.cat([out.rgb, out.disparity[None], out.transmittance[None]]).flatten(1).T.numpy()
    digits = digits_of(fifty_digits.composite_competing, logit, rgb, covered, maps, options=[2.0])
    assert np.abs(found - digits).max() < 1e-12
    assert (digits[0] == [0, 0, 0, 0, 1]).all()


def test_blend_in_50_digits_equals_the_reference(rng):
    logits, colour, distances = rng.normal(0, 3, (3, PIXELS)), rng.random((3, 3, PIXELS)), np.array([0, 1, 5.0])
    coverage = (rng.random((3, PIXELS)) > 0.4) * rng.random((3, PIXELS))
    logits, colour, coverage = (values.astype(np.float32) for values in (logits, colour, coverage))
    coverage[:, 0] = 0
    logits[1, 1] = np.inf
    alpha, rgb = blend(*(tensor[None] for tensor in double(logits, colour, coverage)), torch.from_numpy(distances))
    digits = digits_of(fifty_digits.blend, logits, colour, coverage, options=[distances])
    assert np.abs(torch.cat([alpha, rgb[0]]).flatten(1).T.numpy() - digits).max() < 1e-12


def test_composite_in_50_digits_equals_the_reference(rng):
    alpha, rgb, maps = (rng.random(shape) for shape in ((4, PIXELS), (4, 3, PIXELS), (4, PIXELS)))
    for background in (True, False):
        tensors = double(alpha, rgb, maps)
        out = composite(*tensors[:2], torch.full((1, PIXELS), background), tensors[2])
        found = torch.cat([out.rgb[:, 0], out.disparity, out.transmittance]).T.numpy()
        digits = digits_of(fifty_digits.composite, alpha, rgb, maps, options=[background])
        assert np.abs(found - digits).max() < 1e-14


def test_random_numbers_are_those_of_splitmix64():
    assert units(0, 2).tolist() == [np.float32((x >> 11) / 2**53) for x in (0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4)]


def test_powers_are_short():
    assert [exponent(x) for x in (1e-6, 0.0, np.inf, 1e300)] == ["1e-6", "0e0", "inf", "1e300"]
    assert exponent(2.54e-7, 1) == "2.5e-7"


def test_errors_leave_out_doubtful_pixels_and_non_finite_values_are_infinite():
    truth = Truth({"coverage": np.full(6, 0.5)}, np.array([False, True, True, True, True, False]))

    def errors(*values: float) -> Errors:
        return truth.errors({"coverage": np.array(values, np.float32)}, 1e-3)

    assert errors(0.75, 0.9, 0.5, 0.1, 0.5, 0.5) == Errors(0.25, 0.5)
    assert errors(0.5, 0.9, 0.5, 0.5, 0.5, 0.5) == Errors(0.0)
    assert errors(0.5, np.nan, 0.5, 0.5, 0.5, 0.5).largest == np.inf


def outcome(rust: float, torch_: float, **changed) -> Outcome:
    inputs = Inputs()
    inputs.stage, inputs.must_cover = "warp", True
    case = Case("depth", "1e0", inputs, 1e-5)
    return replace(Outcome(case, {"Rust": Errors(rust), "torch": Errors(torch_)}), **changed)


def test_error_beyond_the_bound_or_twice_that_of_torch_fails():
    good = [outcome(9e-6, 5e-6), outcome(1e-7, 0), outcome(0, 0, truth_error=1e-6, covered=0.1, relative_time=4)]
    bad = {
        "bound": outcome(2e-5, 1),
        "twice torch's": outcome(9e-6, 4e-6),
        "inf": outcome(np.inf, np.inf),
        "expected outputs": outcome(0, 0, truth_error=1e-4),
        "themselves off by nan": outcome(0, 0, truth_error=np.nan),
        "no pixel": outcome(0, 0, covered=0.0),
        "times as long": outcome(0, 0, relative_time=30),
        "fx is 0": outcome(0, 0, refused="fx is 0"),
        "last bit": outcome(0, 0, equal=False),
        "doubtful": outcome(0, 0, errors={"Rust": Errors(0, 0.02), "torch": Errors(0)}),
    }
    assert [list(case.failures()) for case in good] == [[], [], []]
    for why, case in bad.items():
        assert why in next(case.failures())
    every = [*good, *bad.values()]
    assert "3 of 13 cases pass" in by_family("A rig.", every) and "| *NaN* | *NaN* | **10 failed** |" in by_family(
        "", every
    )
    assert "| depth | 1e0 | **2.0e-5** | **1.0e0** |" in by_case("A rig.", every)


WORKSHOP = ROOT / "tests/scenes/workshop"


@pytest.fixture(scope="module")
def liveview():
    return pytest.importorskip("liveview_ref.extension", exc_type=ImportError).liveview


@pytest.fixture(scope="module")
def cases(liveview) -> dict[str, Case]:
    """An ordinary case of each stage."""
    from liveview_ref.parity.stability import blend as blends
    from liveview_ref.parity.stability import composite, composite_competing, network, rigs, sampling, select

    networks = network.Networks(MODELS / "liveview_v4.onnx")
    rig = rigs.Rig.of(WORKSHOP, "target_0", 4)
    families = [*rigs.families(rig), *sampling.families(), *blends.families(rig.distances), *composite.families()]
    families += [*composite_competing.families(), *select.families(), *network.families(networks)]
    named = {(case.family, case.name): case for family in families for case in family}
    assert len(named) == sum(map(len, families)) == 360
    ordinary = {
        "warp": ("depth", "1e0"),
        "sampling": ("photo size", "3x5"),
        "blend": ("logits", "times 1e0"),
        "composite": ("number of planes", "16"),
        "composite_competing": ("number of competing", "16"),
        "select": ("selection", "one plane"),
        "network": ("network", "noise"),
    }
    return {stage: named[name] for stage, name in ordinary.items()}


def off(found):
    """Outputs that depart a little."""
    if isinstance(found, np.ndarray):
        return found + found.dtype.type(1 if found.dtype.kind == "i" else 1e-4)
    return tuple(off(part) for part in found)


@pytest.mark.parametrize(
    "name, function",
    [
        ("warp", "warp_maps"),
        ("sampling", "warp_maps"),
        ("blend", "blend"),
        ("composite", "composite"),
        ("composite_competing", "composite_competing"),
        ("select", "plane_histogram"),
        ("network", None),
    ],
)
def test_planted_departure_of_a_stage_fails(liveview, cases, monkeypatch, name, function):
    case = cases[name]
    assert list(Outcome.of(case).failures()) == []
    if function:
        right = getattr(liveview, function)
        monkeypatch.setattr(liveview, function, lambda *arguments: off(right(*arguments)))
    else:
        right = case.inputs.networks.rust
        monkeypatch.setitem(vars(case.inputs.networks), "rust", lambda hwv: off(right(hwv)))
    assert next(Outcome.of(case).failures())


def test_inputs_that_are_refused_fail(cases):
    case = cases["warp"]
    source = replace(case.inputs.source, rotation=2 * case.inputs.source.rotation)
    spoiled = replace(case, inputs=replace(case.inputs, source=source))
    assert next(Outcome.of(spoiled).failures()).startswith("refused: source: ")


def test_unknown_scene_target_or_model_is_an_error(liveview, tmp_path, monkeypatch, capsys):
    from liveview_ref.parity.stability.__main__ import main

    for arguments, text in [
        ([str(tmp_path / "missing"), "--target", "target_0"], "missing"),
        ([str(WORKSHOP), "--target", "nobody"], "--target nobody: expected one of source_0"),
        ([str(WORKSHOP), "--target", "target_0", "--model", "no.onnx"], "no.onnx"),
    ]:
        monkeypatch.setattr("sys.argv", ["stability", *arguments])
        assert main() == 2
        out, message = capsys.readouterr()
        assert out == "" and message.startswith("error: ") and text in message


def test_departure_is_in_the_table_and_in_the_exit_code(liveview, monkeypatch, capsys):
    from liveview_ref.parity.stability import composite, composite_competing, network, rigs, sampling
    from liveview_ref.parity.stability.__main__ import main

    for stage in (composite, composite_competing, network, rigs, sampling):
        monkeypatch.setattr(stage, "families", lambda *_: [])
    monkeypatch.setattr("sys.argv", ["stability", str(WORKSHOP), "--target", "target_0", "--short"])
    assert main() == 0
    out, message = capsys.readouterr()
    assert "18 of 18 cases pass." in out and "failed" not in out and message == ""
    right = liveview.blend
    monkeypatch.setattr(liveview, "blend", lambda *arguments: off(right(*arguments)))
    assert main() == 2
    out, message = capsys.readouterr()
    assert "| logits | times 1e-6, times 1e38 |" in out and "3 of 18 cases pass." in out
    assert message.count("**failed**: off by") == len(message.splitlines()) == 15 and "selection" not in message
