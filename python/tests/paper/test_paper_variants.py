"""The renderings of LiveView in the paper's comparison, those with a departure undone, and windows
of their targets."""

import pytest
import torch
from paper_toys import HEIGHT, WIDTH, toy

from liveview_ref.paper.data.shots import window
from liveview_ref.paper.measure import departures, variants
from liveview_ref.paper.methods.liveview import Competing, input_centred
from liveview_ref.paper.methods.registry import ENTRIES, entry


def test_variants_of_liveview_equal_the_renderings_of_the_method(net):
    shot = toy()
    found = dict(variants.renderings(net, shot, (4, 12), 2.0))
    assert list(found) == [
        "planes:4", "planes:4, competing", "planes:12", "planes:12, competing", "select:8/12", "select:8/12, competing",
    ]  # fmt: skip
    with torch.inference_mode():
        for count in (4, 12):
            plain = net(shot.photos, shot.camera, shot.planes(count)).rgb
            assert (found[f"planes:{count}"] - plain).abs().max() < 1e-5
    assert (found["planes:12"] - found["planes:12, competing"]).abs().max() > 1e-3


def test_competing_planes_take_photos_nearest_first():
    torch.manual_seed(0)
    method, shot = Competing(4).eval(), toy()
    found = dict(variants.renderings(method, shot, (4,), 1.0))
    with torch.inference_mode():
        own = method(shot.photos, shot.camera, shot.planes(4)).rgb
    assert (found["planes:4, competing"] - own).abs().max() < 1e-5
    assert (found["planes:4"] - own).abs().max() > 1e-3


def test_selected_planes_are_the_fullest_of_the_histogram(net):
    planes = variants.plane_by_plane(net, shot := toy(), shot.planes(12))
    most = torch.bincount(planes.alpha.argmax(0).flatten(), minlength=12).argsort(descending=True, stable=True)[:8]
    expected = variants.independent(planes, sorted(most.tolist()))
    assert torch.equal(dict(variants.renderings(net, shot, (12,)))["select:8/12"], expected)


def test_competing_planes_are_selected_by_distance_to_the_best(net, monkeypatch):
    monkeypatch.setattr(variants, "SELECTED", (2,))
    best = torch.cat([torch.zeros(40), torch.ones(50), torch.full((45,), 2), torch.full((30,), 7)])
    logit = torch.zeros(8, 1, len(best))
    logit.scatter_(0, best.long()[None, None], 5.0)
    planes = variants.Planes(torch.sigmoid(logit), torch.rand(8, 3, 1, len(best)), logit, logit > -1)
    monkeypatch.setattr(variants, "plane_by_plane", lambda *given: planes)
    found = dict(variants.renderings(net, toy(), (8,), 2.0))
    assert torch.equal(found["select:2/8, competing"], variants.competing(planes, 2.0, [1, 7])[0])
    assert torch.equal(found["select:2/8"], variants.independent(planes, [1, 2]))


def test_other_methods_have_no_selected_or_competing_planes():
    torch.manual_seed(0)
    method = input_centred(4).eval()
    assert list(dict(variants.renderings(method, toy(), (4, 8)))) == ["planes:4", "planes:8"]


def test_window_crops_truth_disparity_and_camera(net):
    shot = toy()
    part = window(shot, 8, 16, 32, 16)
    assert torch.equal(part.truth, shot.truth[:, 16:32, 8:40])
    assert part.disparity.shape == (16, 32)
    with torch.inference_mode():
        whole = variants.plane_by_plane(net, shot, shot.planes(2))[3]
        cut = variants.plane_by_plane(net, part, shot.planes(2))[3]
    assert torch.equal(whole[:, 16:32, 8:40], cut)


def test_weights_of_the_named_entry_fit():
    for each in [e for e in ENTRIES if e.weights]:
        own, other = each.build(each.views), entry(each.weights).build(entry(each.weights).views)
        shapes = [{name: tuple(value.shape) for name, value in m.state_dict().items()} for m in (own, other)]
        assert shapes[0] == shapes[1]


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
