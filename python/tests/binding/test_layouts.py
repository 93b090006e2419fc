"""Arrays of any layout are read and never written to: every array argument of every function gives
the same bits if it is read only, strided, reversed, of Fortran's order, misaligned or torch's."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hostile_cases import Cases


def read_only(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array.flags.writeable = False
    return array


def strided(array: np.ndarray) -> np.ndarray:
    return np.repeat(array, 2, -1)[..., ::2]


def reversed_twice(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array[::-1])[::-1]


def misaligned(array: np.ndarray) -> np.ndarray:
    found = np.empty(array.nbytes + 1, np.uint8)[1:].view(array.dtype).reshape(array.shape)
    found[...] = array
    return found


LAYOUTS = [read_only, strided, reversed_twice, np.asfortranarray, misaligned, torch.from_numpy]


@pytest.fixture(scope="module")
def cases(liveview) -> Cases:
    """Good arguments, with values that differ from pixel to pixel."""
    cases = Cases(liveview)
    noise = np.random.default_rng(5)

    def varied(array: np.ndarray) -> np.ndarray:
        return noise.uniform(0.2, 0.8, array.shape).astype(np.float32) if array.dtype == np.float32 else array

    cases.good = {name: mapped(arguments, varied) for name, arguments in cases.good.items()}
    return cases


def mapped(value, change):
    """The arguments with `change` of each array."""
    if isinstance(value, np.ndarray):
        return change(value)
    if isinstance(value, SimpleNamespace):
        return SimpleNamespace(**mapped(vars(value), change))
    if isinstance(value, dict):
        return {name: mapped(item, change) for name, item in value.items()}
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*(mapped(item, change) for item in value))
    return type(value)(mapped(item, change) for item in value) if isinstance(value, (list, tuple)) else value


def bits(found):
    if isinstance(found, (list, tuple)):
        return [bits(item) for item in found]
    if type(found).__name__ == "Scene":
        return [found.photo(name).tobytes() for name in found.names], found.cameras
    return found.tobytes() if isinstance(found, np.ndarray) else found


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.__name__)
def test_arrays_of_any_layout_give_the_same_bits(cases, layout):
    for name, arguments in cases.good.items():
        if name in ("synthesizer", "live"):  # without arrays
            continue
        given = []

        def other(array: np.ndarray, given=given):
            given.append((layout(array), array))
            return given[-1][0]

        assert bits(cases.call(name, **mapped(arguments, other))) == bits(cases.call(name, **arguments)), name
        for array, before in given:
            np.testing.assert_array_equal(np.asarray(array), before, err_msg=name)
