"""The page of the paper's comparison."""

import json
import re

import pytest

from liveview_ref.paper import train
from liveview_ref.paper.files import read, write
from liveview_ref.paper.measure import score
from liveview_ref.paper.measure.means import mean
from liveview_ref.paper.report import figures, results, tables
from liveview_ref.paper.report import page as report
from liveview_ref.paper.report.verdicts import verdicts
from liveview_ref.paths import MODELS
from tools.paper_headline import headline

PUBLISHED = MODELS / "paper" / "published.json"


def scored(name: str, views: int, psnr: float, counts=(8, 16, 32, 64), competing=False) -> dict:
    """A report of the scores of two scenes, 0.5 dB apart; each larger number of planes is better by
    1 dB."""
    layers = {}
    for suffix, more in (("", 0.0), (", competing", 3.0))[: 1 + competing]:
        for i, n in enumerate(counts):
            layers[f"planes:{n}{suffix}"] = {"psnr": psnr + more + i, "ssim": 0.9 + i / 100, "lpips": 0.1}
        if competing:
            layers[f"select:16/64{suffix}"] = {"psnr": psnr + more, "ssim": 0.928, "lpips": 0.1}
    about = {"step": 1500, "samples": 3000, "core_seconds": 3600}
    targets = [target(scene, layers, change) for scene, change in (("0000", -0.25), ("0001", 0.25))]
    report_ = {"entry": f"{name}_v{views}", "name": name, "views": views, "data": "rig", "about": about}
    return report_ | {"targets": targets, "key": {"trained_on": "rig"}, "scale": 2.0}


def target(scene: str, layers: dict, change: float) -> dict:
    scores = {name: row | {"psnr": row["psnr"] + change} for name, row in layers.items()}
    return {"scene": scene, "target": "0", "scores": scores}


def saved(models, report: dict) -> None:
    path = models / f"scores_{report['data']}.json"
    write(path, (read(path) if path.exists() else {}) | {report["entry"]: report})


def cost_row(name: str, planes: int, seconds: float) -> dict:
    spread = {"median": seconds, "lowest": seconds / 2, "highest": seconds * 2}
    stages = {"warp": seconds / 4, "network": seconds / 2, "render": seconds / 4}
    row = {"name": name, "views": 5, "planes": planes, "seconds": spread, "stages": stages, "cpu_seconds": 2 * seconds}
    row |= {"peak_memory": 3 * 2**30}
    return row | {"multiply_adds_per_pixel": 28_000.0 * planes, "parameters": 392_000}


@pytest.fixture
def models(tmp_path):
    """models/paper with nothing but the paper's figures, and docs."""
    folder = tmp_path / "models" / "paper"
    folder.mkdir(parents=True)
    (tmp_path / "docs").mkdir()
    (folder / "published.json").write_bytes(PUBLISHED.read_bytes())
    return folder


def page(models) -> str:
    path = models.parents[1] / "docs" / "paper-comparison.md"
    report.write(models, path)
    return path.read_text()


def test_page_without_results_names_every_cell_as_missing(models):
    text = page(models)
    for row in json.loads(PUBLISHED.read_text())["comparison"]:
        assert f"{results.title(row['method'])}, {row['views']} views: not scored on the rig's scenes yet." in text
    for row in json.loads(PUBLISHED.read_text())["speed"]:
        assert f"{results.title(row['method'])}, {row['planes']} planes, run time: not measured yet." in text
    assert "{{" not in text and "LiveView is not scored yet." in text
    assert "*34.29 / 0.9678 / 0.0565*" in text and "*70.6 times*, not measured here yet" in text


def test_page_with_all_results_has_every_cell(models):
    for row in json.loads(PUBLISHED.read_text())["comparison"]:
        name, views = row["method"], row["views"]
        own = scored(name, views, 20.0, competing=name == "liveview")
        saved(models, own)
        saved(models, own | {"data": "real"})
    history = [{"step": 500, "samples": 1000, "psnr": 20.0}, {"step": 1000, "samples": 2000, "psnr": 21.0}]
    (models / "training.json").write_text(json.dumps({"liveview_v4": {"history": history}}))
    rows = [cost_row("light_field_fusion_v10", 64, 40.0), cost_row("local_light_field_v5", 64, 20.0)]
    rows += [cost_row("stereo_magnification_v5", 64, 2.0), *(cost_row("liveview_v5", n, n / 16) for n in (64, 32, 16))]
    about = {
        "size": [504, 352],
        "threads": 2,
        "rounds": 3,
        "cpu": "a CPU",
        "rows": [*rows, cost_row("program", 16, 0.5)],
    }
    (models / "cost.json").write_text(json.dumps(about))
    text = page(models)
    assert "not scored on" not in text and "not measured yet" not in tables.missing(results.load(models))
    table = text[text.index("| V | method |") : text.index("### Cells")]
    assert "| 4 | LiveView, competing | 64 | 26.00 ± 0.25 / 0.9300 / 0.1000 | 26.00 ± 0.25 / 0.9300 / 0.1000 |" in table
    ours = [line.split(" | ")[3:5] for line in table.splitlines() if re.match(r"\| \d", line)]
    assert len(ours) == 11 and all(tables.DASH not in cell for cells in ours for cell in cells)
    assert "*70.6 times*, 40.0 times here (40.0 by processor time)." in text
    assert "This program on 16 planes is faster than Light Field Fusion (LLFF) in PyTorch: 80.0 times here" in text
    assert "they count multiply-adds" in text
    assert (models / "training.svg").exists() and (models / "selection.svg").exists()
    assert "8, 16, 32 and 64 planes: 23.00, 24.00, 25.00, 26.00 dB, rising." in text
    assert "SSIM 0.9280, 0.9300 on all (-0.22%)" in text
    assert "The best other method: Soft3D, 23.00 dB (+3.00 dB for LiveView)." in text
    assert "rig scenes: 2 targets of 2 scenes, trained on rig" in text and report.LEFT_OUT not in text


def test_means_are_over_the_targets_that_all_methods_have(models):
    saved(models, scored("liveview", 4, 20.0))
    part, other = scored("soft3d", 4, 21.0), scored("deepview", 4, 22.0)
    part["targets"].pop()
    other["targets"] = [each | {"scene": "9999"} for each in other["targets"][:1]]
    saved(models, part)
    saved(models, other)
    text = page(models)
    assert "| 4 | LiveView | 64 | 22.75 / 0.9300" in text and "| 4 | Soft3D | 64 | 23.75 / 0.9300" in text
    assert "rig scenes: 1 target of 1 scene," in text and "1 target." in text
    assert f"{report.LEFT_OUT}\n- LiveView at V = 4: 0001/0" in text and "- DeepView, small at V = 4: 9999/0" in text
    assert "| 4 | DeepView, small *(80 planes)* | – | – |" in text


def test_falling_score_is_reported_as_not_rising():
    own = scored("liveview", 4, 20.0)
    own["mean"] = mean(own["targets"])
    own["mean"]["planes:64"]["psnr"] = 19.0
    found = results.Results({}, {("rig", "liveview", 4): own})
    assert "not rising throughout" in verdicts(found)


def test_headline_compares_methods_with_the_same_number_of_views():
    reports = {}
    for name, views, psnr in (
        ("liveview", 4, 20.0),
        ("liveview", 5, 24.0),
        ("local_light_field", 5, 25.0),
        ("soft3d", 4, 31.0),
        ("liveview_no_network", 4, 30.0),
    ):
        counts = (3,) if name == "liveview_no_network" else (8, 16, 32, 64)
        reports["rig", name, views] = own = scored(name, views, psnr, counts, competing=name == "liveview")
        own["mean"] = mean(own["targets"])
    text = " ".join(headline(results.Results({}, reports)).split())
    assert "V = 5: Local Light Field reaches 28.0 dB, LiveView 27.0 by the paper's composite and 30.0" in text
    assert "V = 4: Soft3D, which needs no training, reaches 34.0 dB, *surface* without a network 30.0" in text
    assert headline(results.Results({}, {})) == "Not scored yet."


def test_methods_not_in_the_paper_are_rows_too(models):
    saved(models, scored("input_centred", 5, 21.0))
    assert "| 5 | LiveView's network, input-centred | 64 | 24.00 ± 0.25" in page(models)
    assert figures.ablation(results.load(models)) is None  # no other method to compare with
    saved(models, scored("local_light_field", 5, 20.0))
    assert figures.ablation(results.load(models)).count("<polyline") == 4  # two curves in each panel
    assert "dynamic or static, 5 views: not scored yet: LiveView; Local LF, target-centred." in page(models)
    saved(models, scored("liveview", 5, 22.0, (16, 64)))
    saved(models, scored("local_light_field_at_target", 5, 18.0, (16, 64)))
    text = page(models)
    assert "target-centred instead of input-centred -1.00 dB (dynamic) and -4.00 dB (static)" in text
    assert "dynamic instead of static +4.00 dB (target-centred) and +1.00 dB (input-centred)" in text


def test_networks_trained_on_fewer_planes_have_a_figure(models):
    assert figures.trained_planes(results.load(models)) is None
    assert "not scored yet: LiveView, trained on 16 planes; LiveView, trained on 32 planes; Local" in page(models)
    saved(models, scored("liveview_on_16", 5, 21.0))
    assert figures.trained_planes(results.load(models)).count("<polyline") == 2
    text = page(models)
    assert "not scored yet: LiveView, trained on 32 planes; Local" in text
    assert "| LiveView, trained on 16 planes | uniform |" in text
    assert "| LiveView, trained on 16 planes | 64 |" not in text


def test_longer_training_stands_beside_the_shorter(models):
    assert "Not trained yet." in page(models)
    longer = models / results.LONGER
    longer.mkdir()
    assert "Not scored yet." in page(models)
    for folder, psnr, samples in ((models, 20.0, 3000), (longer, 22.0, 15_000)):
        for name, better in (("liveview", 1.5), ("local_light_field", 0.0), ("stereo_magnification", -1.0)):
            own = scored(name, 5, psnr + better, competing=name == "liveview")
            saved(folder, own | {"about": own["about"] | {"samples": samples}})
    trained = {"history": [{"samples": 1000, "psnr": 20.0}], "planes": 32}
    (longer / "training.json").write_text(json.dumps({"liveview_v5": trained, "local_light_field_v5": trained}))
    text = page(models)
    cells = "24.50 ± 0.25 / 0.9300 / 0.1000 | 25.50 ± 0.25 / 0.9200 / 0.1000"
    assert f"| 5 | LiveView | 3,000 / 15,000 | 64 / 32 | {cells} |" in text
    assert "| 5 | LiveView, competing | 3,000 / 15,000 | 64 / 32 | 27.50 ± 0.25" in text
    assert "- **V = 5**: LiveView 25.50 dB on 32 planes, Local Light Field (Local LF) 24.00 (+1.50 dB" in text
    assert "LiveView 25.50 dB on 32 planes, Stereo Magnification 24.00 on 64 (+1.50 dB for LiveView)." in text
    assert (models / "longer.svg").exists()


def test_effects_of_departures_come_from_their_file(models):
    means = {"unchanged": {"psnr": 25.0, "difference": 0.0}, "no normalisation by coverage": {"psnr": 24.0}}
    means["no normalisation by coverage"] |= {"difference": -1.0, "border_difference": -9.0}
    means["competing planes, scale 2"] = {"psnr": 33.0, "difference": 8.0}
    (models / "departures.json").write_text(json.dumps({"liveview_v4": {"targets": [{}] * 5, "mean": means}}))
    text = page(models)
    assert "undone (no normalisation by coverage): liveview_v4: -1.00 (border: -9.00) |" in text
    assert "introduced (competing planes, scale 2): liveview_v4: +8.00 |" in text
    assert "quarters of 5 of the rig's targets" in text and "undone (padded with zeros): not measured yet" in text


@pytest.mark.parametrize("module", [score, train])
def test_commands_of_the_page_have_valid_options(module, monkeypatch, capsys):
    text = (report.HERE / "page.md").read_text().replace("\\\n", "")
    used = set(re.findall(r"--[a-z-]+", " ".join(re.findall(rf"-m {module.__name__} (--.*)", text))))
    monkeypatch.setattr("sys.argv", ["", "--help"])
    with pytest.raises(SystemExit):
        module.main()
    known = set(re.findall(r"--[a-z-]+", capsys.readouterr().out))
    assert {"--data", "--scenes", "--textures", "--out"} <= used <= known


def test_invalid_json_is_refused_with_its_file(models):
    (models / "cost.json").write_text("{")
    with pytest.raises(ValueError, match="cost.json: .*expected JSON"):
        results.load(models)
