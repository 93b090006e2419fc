"""The output of `liveview inspect --json` conforms to docs/inspect.schema.json,
without other fields."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

jsonschema = pytest.importorskip("jsonschema")

ROOT = Path(__file__).parents[3]
WORKSHOP = ROOT / "tests" / "scenes" / "workshop"
LIVEVIEW = ROOT / "target" / "release" / "liveview"
SCHEMA = json.loads((ROOT / "docs" / "inspect.schema.json").read_text())

pytestmark = pytest.mark.skipif(not LIVEVIEW.exists(), reason="needs `make build`")


def inspect(scene: Path, *options: str) -> dict:
    done = subprocess.run([LIVEVIEW, "inspect", scene, "--json", *options], check=True, capture_output=True)
    return json.loads(done.stdout)


@pytest.fixture
def without_depth(tmp_path) -> Path:
    """Three photos from one place: neither the file nor the photos give a depth."""
    shutil.copytree(WORKSHOP / "images", tmp_path / "images")
    photos = sorted(path.name for path in (tmp_path / "images").iterdir())[:3]
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    frames = [{"file_path": f"images/{name}", "transform_matrix": pose} for name in photos]
    camera = {"fl_x": 400, "fl_y": 400, "cx": 252, "cy": 176, "w": 504, "h": 352}
    (tmp_path / "transforms.json").write_text(json.dumps({**camera, "frames": frames}))
    return tmp_path


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--target", "target_0", "--views", "5"],
        ["--far", "inf"],
        ["--views", "64"],
    ],
)
def test_output_for_the_example_scene_is_valid(options):
    report = inspect(WORKSHOP, *options)
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    jsonschema.validate(report, SCHEMA)
    assert ("warning" in report["target"]) == ("64" in options)


def test_output_for_a_scene_of_unknown_depth_is_valid(without_depth):
    report = inspect(without_depth, "--views", "2")
    jsonschema.validate(report, SCHEMA)
    assert "warning" in report["target"] and isinstance(report["target"]["views"][0], str)


def test_schema_refuses_unknown_fields():
    report = inspect(WORKSHOP)
    report["target"]["planes"]["another"] = 1
    with pytest.raises(jsonschema.ValidationError, match="another"):
        jsonschema.validate(report, SCHEMA)
