"""The page of the paper's comparison."""

import pytest

from liveview_ref.paper.files import write
from liveview_ref.paper.report import page as report
from liveview_ref.paths import MODELS, ROOT

PAPER = MODELS / "paper"
PAGE = ROOT / "docs" / "paper-comparison.md"


def scored(name: str, views: int, psnr: float, scenes=("0000", "0001"), competing=False) -> dict:
    """Scores of scenes 0.5 dB apart; the next number of planes is better by 1 dB, competing planes
    by 3 dB."""
    layers = {}
    for suffix, more in (("", 0.0), (", competing", 3.0))[: 1 + competing]:
        for i, n in enumerate((8, 16, 32, 64)):
            layers[f"planes:{n}{suffix}"] = {"psnr": psnr + more + i, "ssim": 0.9 + i / 100, "lpips": 0.1}
    targets = [
        {"scene": scene, "target": "0", "scores": {x: row | {"psnr": row["psnr"] + i / 2} for x, row in layers.items()}}
        for i, scene in enumerate(scenes)
    ]
    return {"name": name, "views": views, "about": {"step": 500, "planes": 64}, "targets": targets}


@pytest.fixture
def models(tmp_path):
    """models/paper with nothing but the paper's figures."""
    (tmp_path / "published.json").write_bytes((PAPER / "published.json").read_bytes())
    return tmp_path


def page(models) -> str:
    report.write(models, models / "page.md")
    return (models / "page.md").read_text()


def test_page_is_that_of_the_repository(tmp_path):
    report.write(PAPER, tmp_path / "page.md")
    assert (tmp_path / "page.md").read_text() == PAGE.read_text()


def test_scores_are_means_over_scenes_on_the_planes_of_the_training(models):
    write(models / "scores_rig.json", {"liveview_v4": scored("liveview", 4, 20.0, competing=True)})
    longer = scored("liveview", 4, 22.0)
    longer["about"]["planes"] = 32
    (models / "longer").mkdir()
    write(models / "longer" / "scores_rig.json", {"liveview_v4": longer})
    text = page(models)
    assert "| 4 | LiveView | 23.25±0.25, 0.930, 0.100 | 24.25±0.25, 0.920, 0.100 | – | *32.01* |" in text
    assert "| 4 | LiveView, competing | 26.25±0.25, 0.930, 0.100 | – | – | – |" in text
    assert "Rig: 2 targets of 2 scenes" in text and "| 4 | 23.25 (21.25) | – (–) |" in text


def test_means_are_over_the_targets_that_all_methods_have(models):
    reports = {"liveview_v4": scored("liveview", 4, 20.0), "soft3d_v4": scored("soft3d", 4, 21.0, ("0000",))}
    reports["deepview_v4"] = scored("deepview", 4, 22.0, ("9999",))
    write(models / "scores_rig.json", reports)
    found = report.load(models / "scores_rig.json")
    assert found.whole("liveview_v4")["psnr"] == 23.0 and found.whole("soft3d_v4")["psnr"] == 24.0
    assert found.whole("deepview_v4") is None and "DeepView, small | – | – | – |" in page(models)


def test_invalid_json_is_refused_with_its_file(models):
    (models / "cost.json").write_text("{")
    with pytest.raises(ValueError, match="cost.json: .*expected JSON"):
        report.write(models, models / "page.md")
