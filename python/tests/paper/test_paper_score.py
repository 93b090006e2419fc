"""Scores of the paper's comparison."""

import json
from dataclasses import dataclass, field

import pytest
import torch
from paper_toys import toy

from liveview_ref.paper.data.shots import window
from liveview_ref.paper.measure import score as scoring
from liveview_ref.paper.measure import variants
from liveview_ref.paper.methods.liveview import liveview
from liveview_ref.paper.methods.method import Method, Rendering
from liveview_ref.paper.methods.registry import Entry


class Constant(Method):
    """A grey picture for any target; counts the renderings."""

    def __init__(self, grey: float):
        super().__init__()
        self.grey, self.rendered = grey, 0

    def forward(self, photos, target, disparities, cover=True):
        self.rendered += 1
        valid = torch.ones(target.height, target.width, dtype=torch.bool)
        return Rendering(torch.full((3, target.height, target.width), self.grey), valid)


@dataclass
class Toys:
    """A source of three targets in two scenes, of which it gives the first `count`."""

    count: int = 3
    scenes: int = 2
    targets: int = 2
    data: str = "rig"
    trained_on: str = "rig"

    def shots(self, split, views):
        all_of_them = [toy(views, 1, "0000"), toy(views, 2, "0001"), toy(views, 3, "0001")]
        all_of_them[2].target = "1"
        return iter(all_of_them[: self.count])


def test_scores_continue_by_target_and_start_again_only_for_another_step(tmp_path):
    entry, source, method = Entry("constant", 4, Constant, planes=(2,)), Toys(), Constant(0.5)
    source.count = 1
    scoring.score(entry, method, {"step": 7}, source, source, tmp_path, None)
    source.count = 3
    found = scoring.score(entry, method, {"step": 7}, source, source, tmp_path, None)
    assert method.rendered == 3 and len(found["targets"]) == 3
    assert scoring.score(entry, method, {"step": 7}, source, source, tmp_path, None) == found and method.rendered == 3
    scoring.score(entry, method, {"step": 8}, source, source, tmp_path, None)
    assert method.rendered == 6
    inner = toy(4, 1).truth[:, 16:-16, 16:-16]
    expected = float(-10 * torch.log10(((inner - 0.5) ** 2).mean()))
    assert found["targets"][0]["scores"]["planes:2"]["psnr"] == pytest.approx(expected, abs=1e-4)
    one, two, three = (target["scores"]["planes:2"]["psnr"] for target in found["targets"])
    row = found["mean"]["planes:2"]
    assert row["psnr"] == pytest.approx((one + (two + three) / 2) / 2, abs=1e-4)
    assert row["psnr_se"] == pytest.approx(abs(one - (two + three) / 2) / 2, abs=1e-4)  # s / sqrt(2), s = |d| / sqrt(2)


def test_scores_of_methods_share_a_file(tmp_path):
    for name in ("constant", "other"):
        scoring.score(Entry(name, 4, Constant, planes=(2,)), Constant(0.5), {"step": 7}, Toys(), Toys(), tmp_path, None)
    assert list(json.loads((tmp_path / "scores_rig.json").read_text())) == ["constant_v4", "other_v4"]


@dataclass
class Splits(Toys):
    """The middle of the target, on which the scale is fitted, is rendered by `net` at one scale for
    validation and at another for test; records the splits that are used."""

    net: Method | None = None
    asked: list[str] = field(default_factory=list)

    def shots(self, split, views):
        self.asked.append(split)
        for shot in super().shots(split, views):
            part = window(shot, 16, 12, 32, 24)
            layers = dict(variants.renderings(self.net, part, (4,), {"validation": 4.0, "test": 0.5}[split]))
            shot.truth[:, 12:36, 16:48] = layers["planes:4, competing"]
            shot.truth += 0.01 * torch.rand(shot.truth.shape, generator=torch.Generator().manual_seed(0))
            yield shot


def test_scale_of_competing_planes_is_the_best_on_validation_alone(net, tmp_path, monkeypatch):
    monkeypatch.setattr(scoring, "INNER", ...)  # the middle of the toy is smaller than two borders
    test, validation = Splits(net=net), Splits(net=net)
    entry = Entry("liveview", 4, liveview, planes=(4,))
    found = scoring.score(entry, net, {"step": 7}, test, validation, tmp_path, None)
    assert (test.asked, validation.asked) == (["test"], ["validation"])
    parts = [window(shot, 16, 12, 32, 24) for shot in validation.shots("validation", 4)]
    expected = {}
    for scale in scoring.SCALES:
        images = [dict(variants.renderings(net, part, (4,), scale))["planes:4, competing"] for part in parts]
        psnr = [float(-10 * torch.log10(((i - p.truth) ** 2).mean())) for i, p in zip(images, parts, strict=True)]
        expected[str(scale)] = pytest.approx(sum(psnr) / 3, abs=1e-3)
    assert found["scales"] == expected
    assert found["scale"] == float(max(found["scales"], key=found["scales"].__getitem__)) == 4.0
