"""parity/goldens is what the script writes."""

import json

import numpy as np

from liveview_ref.parity import goldens


def leaves(value: object, key: str = "") -> list[tuple[str, object]]:
    """All numbers and texts of a JSON value, with their keys."""
    if isinstance(value, dict):
        return [leaf for name, item in value.items() for leaf in leaves(item, f"{key} {name}")]
    if isinstance(value, list):
        return [leaf for item in value for leaf in leaves(item, key)]
    return [(key, value)]


def test_goldens_are_those_of_the_reference():
    found = goldens.goldens()
    assert {path.stem for path in goldens.FOLDER.iterdir()} == set(found)
    for name, cases in found.items():
        text = (goldens.FOLDER / f"{name}.json").read_text()
        assert text.startswith('{"comment": "Written by python/liveview_ref/parity/goldens.py ')
        for (key, stored), (other, expected) in zip(
            leaves(json.loads(text)), leaves(json.loads(goldens.text_of(cases))), strict=True
        ):
            assert key == other
            if isinstance(expected, float):
                # Another processor sums in another order, and numbers are rounded to float32.
                np.testing.assert_allclose(stored, expected, rtol=2e-7, atol=1e-9, err_msg=f"{name}{key}")
            else:
                assert stored == expected, name + key
