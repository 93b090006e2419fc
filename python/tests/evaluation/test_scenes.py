"""Scores of the program's pictures by scene: tearing, the spec, the files."""

import json
import sys

import pytest
import torch

from liveview_ref.data.held_out import BORDER
from liveview_ref.evaluation import scenes
from liveview_ref.paths import BINARY, CONFIGS

SPEC = CONFIGS / "scenes.json"


def test_tearing_counts_visible_errors_away_from_edges():
    truth = torch.zeros(3, 64, 64)
    truth[:, :, 32:] = 1.0
    assert scenes.tearing(truth, truth) == 0
    moved = torch.zeros(3, 64, 64)
    moved[:, :, 33:] = 1.0  # the edge a pixel aside
    assert scenes.tearing(moved, truth) == 0
    torn = truth.clone()
    torn[1, 10:20, 5:15] = 0.5  # a patch on a smooth surface
    away = 64 * (64 - 2 * scenes.NEAR_EDGE - 1)
    assert scenes.tearing(torn, truth) == pytest.approx(100 * 100 / away)
    faint = truth.clone()
    faint[:, 10:20, 5:15] = 0.1
    assert scenes.tearing(faint, truth) == 0


def test_spec_names_seven_and_fourteen_scenes():
    specs = json.loads(SPEC.read_text())
    kinds = [spec["set"] for spec in specs]
    assert (kinds.count("seven"), kinds.count("ordinary")) == (7, 14)
    assert scenes.options_of({"heldout": 8}) == ["--heldout", "8"]
    spec = {"targets": ["a.png"], "held_out": ["b.png"], "near": 1, "far": 100}
    assert scenes.options_of(spec) == ["--target", "a.png,b.png", "--near", "1", "--far", "100"]


def test_scenes_are_scored_as_the_program_scores_them(tmp_path, monkeypatch, capsys):
    assert BINARY.exists(), "run `make build` first"
    spec = tmp_path / "spec.json"
    workshop = next(spec for spec in json.loads(SPEC.read_text()) if spec["name"] == "workshop")
    missing = {"name": "missing", "path": "dev/none", "set": "ordinary", "targets": ["a"]}
    spec.write_text(json.dumps([workshop | {"targets": ["target_0"]}, missing]))
    out = tmp_path / "out"
    options = ["--data", str(tmp_path), "--out", str(out), "--options=--network none --width 160"]
    monkeypatch.setattr(sys, "argv", ["scenes", str(spec), *options])
    assert scenes.main() == 0
    report = json.loads((out / "scores.json").read_text())
    (scores,) = report["scenes"]["workshop"]["targets"].values()
    assert 20 < scores["psnr"] < 40 and 0.8 < scores["ssim"] < 1 and 0 < scores["lpips"] < 0.3
    assert report["means"] == {"seven": report["scenes"]["workshop"]["mean"]}
    assert report["skipped"] == {"missing": "the folder is missing"}
    assert "Skipped: missing" in (out / "scores.md").read_text() and (out / "workshop.jpg").exists()
    assert BORDER == 16 and "skipped missing" in capsys.readouterr().err
