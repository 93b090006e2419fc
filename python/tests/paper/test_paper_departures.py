"""The measurement of departures from the paper."""

import pytest
import torch
from paper_toys import HEIGHT, WIDTH, toy

from liveview_ref.paper.measure import departures
from liveview_ref.paper.report import page as report


def test_undone_departures_change_the_picture_and_restore_the_network(net, monkeypatch):
    monkeypatch.setattr(departures, "PLANES", 4)
    network = departures.Network(net.predictor.net, None, True)
    before = {name: value.clone() for name, value in net.state_dict().items()}
    found = dict(departures.switched(network, toy()))
    plain = found[departures.UNCHANGED]
    for name, image in found.items():
        changed = not torch.allclose(image, plain, atol=1e-6)
        # 64 x 48 is a multiple of 16: there is no padding.
        assert changed == (name not in (departures.UNCHANGED, "padded with zeros")), name
    assert all(torch.equal(value, before[name]) for name, value in net.state_dict().items())
    own = departures.ordered(toy(), True)
    with torch.inference_mode():
        assert torch.allclose(net(own.photos, own.camera, own.planes(4)).rgb, plain, atol=1e-5)


def test_border_is_scored_separately():
    truth = torch.full((3, HEIGHT, WIDTH), 0.5)
    edge, middle = truth.clone(), truth + 0.1
    edge[:, :16] += 0.1  # a third of the rows, all outside the scores' border
    middle[:, :16], middle[:, -16:], middle[:, :, :16], middle[:, :, -16:] = (0.6 + 0.1,) * 4
    border = 1 - (HEIGHT - 32) * (WIDTH - 32) / (HEIGHT * WIDTH)
    inside, outside = (departures.scores_with_border(image, truth) for image in (middle, edge))
    assert inside["psnr"] == pytest.approx(20, abs=1e-3) and inside["border_psnr"] == pytest.approx(13.979, abs=1e-3)
    expected = -10 * torch.log10(torch.tensor(0.01 / 3 / border)).item()
    assert outside["psnr"] > 100 and outside["border_psnr"] == pytest.approx(expected, abs=1e-3)
    found = departures.summary([{"scores": {departures.UNCHANGED: inside, "other": inside | {"border_psnr": 10.0}}}])
    assert found["other"]["difference"] == 0 and found["other"]["border_difference"] == pytest.approx(-3.979, abs=1e-3)


def test_without_zero_logit_the_other_photos_are_weighted_by_their_logits():
    generator = torch.Generator().manual_seed(1)
    logits, volume = torch.randn(1, 3, 2, 2, generator=generator), torch.rand(1, 3, 3, 2, 2, generator=generator)
    rgb = departures.without_zero_logit(logits, volume, torch.ones(1, 3, 2, 2), torch.ones(3))
    share = torch.softmax(logits[:, 1:], 1)
    assert torch.allclose(rgb, (share[:, :, None] * volume[:, 1:]).sum(1), atol=1e-6)


def test_listed_departures_are_those_measured(net, monkeypatch):
    import tomllib

    monkeypatch.setattr(departures, "PLANES", 2)
    known = {
        name
        for scale, first in ((None, True), (1.0, False))
        for name, _ in departures.switched(departures.Network(net.predictor.net, scale, first), toy())
    }
    listed = tomllib.loads((report.HERE / "departures.toml").read_text())["departure"]
    named = {name for each in listed for kind in ("undone", "introduced") for name in each.get(kind, [])}
    assert named == known - {departures.UNCHANGED}
