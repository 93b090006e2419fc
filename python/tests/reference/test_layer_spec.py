"""The text form of layers: every kind is parsed and formatted, other strings are refused
with a reason."""

import pytest

from liveview_ref.reference.layers.spec import DisparityList, Guided, Planes, Select, Surface, parse

SPECS = {
    "planes:64": Planes(64),
    "guided:2": Guided(2),
    "guided:2/32": Guided(2, 32),
    "surface:2": Surface(2),
    "select:16/64": Select(16, 64),
    "list:0.5,0.25,0": DisparityList((0.5, 0.25, 0.0)),
    "list:1000000000000000000000,0.0000001": DisparityList((1e21, 1e-7)),
}


@pytest.mark.parametrize("text", SPECS)
def test_parsed_spec_formats_to_the_same_text(text):
    assert parse(text) == SPECS[text] and str(SPECS[text]) == text


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("many", "expected one like planes:64"),
        ("guided 2", "expected one like"),
        ("planes:", "not a positive whole number"),
        ("planes:0", "not a positive whole number"),
        ("planes:6/4", "not a positive whole number"),
        ("guided:2.5", "not a positive whole number"),
        ("guided:2/1", "at least 2 planes"),
        ("surface:", "not a positive whole number"),
        ("select:65", "more planes than there are"),
        ("select:16/8", "more planes than there are"),
        ("planes:-4", "not a positive whole number"),
        ("list:", "could not convert"),
        ("list:0.25,0.5", "descend"),
        ("list:0.5,0.5", "descend"),
        ("list:0.5,-1", "not negative"),
        ("list:inf,1", "finite"),
        ("list:nan", "finite"),
    ],
)
def test_invalid_spec_is_refused_with_the_reason(text, reason):
    with pytest.raises(ValueError, match=reason) as error:
        parse(text)
    assert f'layers "{text}"' in str(error.value)
