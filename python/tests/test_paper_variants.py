"""How LiveView is rendered for the paper's comparison, and the shots that it is rendered for."""

import pytest
import torch
from paper_toys import HEIGHT, WIDTH, toy

from liveview_ref.paper import variants
from liveview_ref.paper.captured import CapturedScene
from liveview_ref.paper.captured_samples import kind_of
from liveview_ref.paper.methods.liveview import Competing, input_centred
from liveview_ref.paper.registry import ENTRIES, entry
from liveview_ref.paper.shots import shot_of, window


def test_variants_of_liveview_are_what_the_method_renders(net):
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


def test_planes_that_compete_take_photos_nearest_first():
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


def test_planes_that_compete_are_selected_by_how_near_they_lie_to_the_best(net, monkeypatch):
    monkeypatch.setattr(variants, "SELECTED", (2,))
    best = torch.cat([torch.zeros(40), torch.ones(50), torch.full((45,), 2), torch.full((30,), 7)])
    logit = torch.zeros(8, 1, len(best))
    logit.scatter_(0, best.long()[None, None], 5.0)
    planes = variants.Planes(torch.sigmoid(logit), torch.rand(8, 3, 1, len(best)), logit, logit > -1)
    monkeypatch.setattr(variants, "plane_by_plane", lambda *given: planes)
    found = dict(variants.renderings(net, toy(), (8,), 2.0))
    assert torch.equal(found["select:2/8, competing"], variants.competing(planes, 2.0, [1, 7])[0])
    assert torch.equal(found["select:2/8"], variants.independent(planes, [1, 2]))


def test_methods_that_are_not_liveview_have_their_planes_alone():
    torch.manual_seed(0)
    method = input_centred(4).eval()
    assert list(dict(variants.renderings(method, toy(), (4, 8)))) == ["planes:4", "planes:8"]


def test_a_window_is_cut_from_all_that_a_shot_has(net):
    shot = toy()
    part = window(shot, 8, 16, 32, 16)
    assert torch.equal(part.truth, shot.truth[:, 16:32, 8:40])
    assert part.disparity.shape == (16, 32)
    with torch.inference_mode():
        whole = variants.plane_by_plane(net, shot, shot.planes(2))[3]
        cut = variants.plane_by_plane(net, part, shot.planes(2))[3]
    assert torch.equal(whole[:, 16:32, 8:40], cut)


def test_captured_scenes_are_shots_like_the_rigs():
    shot = toy()
    images = [(image * 255).byte() for image in shot.photos.images]
    scene = CapturedScene(
        "s", images, shot.photos.cameras, (0,), ["t"], [(shot.truth * 255).byte()], [shot.camera], None, 2.0, 50.0
    )
    made = shot_of(scene, "s", 0, 4)
    assert made.disparity is None and made.target == "t" and made.planes(3).tolist() == pytest.approx([0.5, 0.26, 0.02])
    assert made.truth.shape == (3, HEIGHT, WIDTH)


def test_data_is_told_by_what_lies_in_its_folder(tmp_path):
    assert kind_of(tmp_path) == "real"
    (tmp_path / "seed0003").mkdir()
    assert kind_of(tmp_path) == "deepfocus"
    (tmp_path / "seed0003").rename(tmp_path / "scene_012")
    assert kind_of(tmp_path) == "spaces"


def test_weights_of_another_entry_fit():
    for each in [e for e in ENTRIES if e.weights]:
        own, other = each.build(each.views), entry(each.weights).build(entry(each.weights).views)
        shapes = [{name: tuple(value.shape) for name, value in m.state_dict().items()} for m in (own, other)]
        assert shapes[0] == shapes[1]
