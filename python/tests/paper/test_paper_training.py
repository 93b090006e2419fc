"""The comparison's rig, its scenes and its training."""

import pytest
import torch

from liveview_ref.paper import train
from liveview_ref.paper.data import rig
from liveview_ref.paper.data.samples import CROP, RigSamples
from liveview_ref.paper.data.scenes import RigScene
from liveview_ref.paper.measure import score
from liveview_ref.paper.methods import registry
from liveview_ref.paper.methods.method import Method, Rendering
from liveview_ref.reference.liveview import PlaneSweep


class Scenes:
    """Scenes of a slanted plane, whose disparity is exact in every camera."""

    def __init__(self, count: int = 2):
        generator = torch.Generator().manual_seed(3)
        places = [(0.25, -0.5), (-0.125, 0.375)]
        cameras = len(rig.CENTRES) + len(places)
        image = torch.randint(0, 256, (3, rig.HEIGHT, rig.WIDTH), generator=generator, dtype=torch.uint8)
        ramp = torch.linspace(0.1, 0.9, rig.WIDTH).expand(cameras, rig.HEIGHT, -1)
        self.scenes = [RigScene(image.expand(cameras, -1, -1, -1), ramp.half(), places)] * count

    def __len__(self) -> int:
        return len(self.scenes)

    def __getitem__(self, number: int) -> RigScene:
        return self.scenes[number]


class Tint(Method):
    """The target's window of the first photo, times a learned tint."""

    def __init__(self, views: int):
        super().__init__()
        self.tint = torch.nn.Parameter(torch.full((3, 1, 1), 0.5))

    def forward(self, photos, target, disparities, cover=True):
        valid = torch.ones(target.height, target.width, dtype=torch.bool)
        left, top = (round(rig_c - float(target.k[i, 2])) for i, rig_c in enumerate((rig.WIDTH / 2, rig.HEIGHT / 2)))
        image = photos.images[0][:, top : top + target.height, left : left + target.width]
        alpha = torch.full((len(disparities), target.height, target.width), 0.1)
        return Rendering(image * self.tint, valid, alpha, target)


def test_every_number_of_views_surrounds_the_middle_square():
    for views, ids in rig.VIEWS.items():
        places = torch.tensor([rig.CENTRES[i] for i in ids])
        assert len(set(ids)) == views
        assert torch.allclose(places.mean(0), torch.zeros(2))
        for reference in rig.REFERENCES[views]:
            assert reference < views
    halves = torch.tensor([rig.CENTRES[i] for i in rig.VIEWS[10]]).reshape(2, 5, 2)
    assert torch.allclose(halves.mean(1), halves[:, 0])  # each reference is the centre of its group of five


def test_neighbouring_corners_have_the_stated_parallax_at_the_nearest_depth():
    left, right = rig.camera(-0.5, 0), rig.camera(0.5, 0)
    at_infinity, near = (PlaneSweep.of(left, right).source_from_target(d) for d in (0.0, 1.0))
    assert abs(float((near - at_infinity)[0, 2]) - rig.PARALLAX) < 1e-9


def test_samples_are_the_same_for_every_method_and_differ_by_number():
    samples = RigSamples(Scenes())
    one, again, other = samples(4, 5), samples(10, 5), samples(4, 6)
    assert torch.equal(one.truth, again.truth) and torch.equal(one.target.k, again.target.k)
    assert not torch.equal(one.target.k, other.target.k)
    assert len(one.photos.images) == 4 and len(again.photos.images) == 10


def test_disparity_of_a_window_is_cropped_from_its_camera_and_nan_outside():
    sample = RigSamples(Scenes())(5, 1)
    whole, disparity = sample.scene.at(sample.target.centre)
    left = round(float(whole.k[0, 2] - sample.target.k[0, 2]))
    top = round(float(whole.k[1, 2] - sample.target.k[1, 2]))
    cut = disparity[top : top + CROP, left : left + CROP]
    assert torch.equal(sample.disparity_at(sample.target), cut)
    beyond = sample.disparity_at(sample.photos.cameras[0].with_window(-8, 0, 32, 16))
    assert bool(beyond[:, :8].isnan().all()) and bool(beyond[:, 8:].isfinite().all())


def test_resumed_training_equals_uninterrupted_training(tmp_path, monkeypatch):
    monkeypatch.setattr(train, "TURN", 2)
    monkeypatch.setattr(train, "VALIDATE_EVERY", 4)
    entry, scenes = registry.Entry("tint", 4, Tint, planes=(4,)), Scenes()
    samples = RigSamples(scenes)
    whole = train.Trainee(entry, tmp_path / "whole")
    whole.turn(samples, scenes)
    whole.turn(samples, scenes)
    train.Trainee(entry, tmp_path / "cut").turn(samples, scenes)
    resumed = train.Trainee(entry, tmp_path / "cut")
    assert resumed.step == 2
    resumed.turn(samples, scenes)
    assert torch.equal(whole.method.tint, resumed.method.tint)
    assert torch.equal(whole.average.tint, resumed.average.tint)
    assert [h["psnr"] for h in whole.history] == [h["psnr"] for h in resumed.history]
    assert float(whole.method.tint.mean()) > 0.5  # the photo's colours fit better


class Normed(Tint):
    """With BatchNorm, whose statistics are estimated again when weights are loaded."""

    def __init__(self, views: int):
        super().__init__(views)
        self.norm = torch.nn.BatchNorm2d(3)

    def forward(self, photos, target, disparities, cover=True):
        found = super().forward(photos, target, disparities, cover)
        return Rendering(self.norm(found.rgb[None])[0], found.valid, found.alpha, found.camera)


def test_trained_weights_are_loaded_for_scoring_and_for_further_training(tmp_path, monkeypatch):
    monkeypatch.setattr(train, "TURN", 2)
    monkeypatch.setattr(train, "STATISTICS", 2)
    entry, samples = registry.Entry("normed", 4, Normed, planes=(2, 4)), RigSamples(Scenes())
    train.Trainee(entry, tmp_path / entry.key).turn(samples, Scenes(1))
    trained, about = score.load(entry, tmp_path, samples)
    assert (about["step"], about["samples"], about["planes"]) == (2, 2 * train.BATCH, 4)
    assert not torch.equal(trained.tint, Normed(4).tint)  # not the initial weights
    further = train.Trainee(entry, tmp_path / "further", tmp_path / entry.key)
    assert torch.equal(further.method.tint, trained.tint)


def test_training_on_fewer_planes_leaves_methods_made_for_a_number_of_planes(tmp_path):
    any_number, fixed = (registry.Entry("tint", 4, Tint, planes=planes) for planes in ((2, 4), (4,)))
    assert train.Trainee(any_number, tmp_path, most=3).planes == 3
    assert train.Trainee(any_number, tmp_path, most=8).planes == 4
    assert train.Trainee(fixed, tmp_path, most=3).planes == 4


def test_training_does_not_continue_on_another_number_of_planes(tmp_path):
    entry = registry.Entry("tint", 4, Tint, planes=(2, 4))
    trained = train.Trainee(entry, tmp_path, most=3)
    states = {name: getattr(trained, name).state_dict() for name in ("method", "average", "optimiser")}
    torch.save(states | {"step": 0, "seconds": 0.0, "history": [], "planes": 3}, trained.checkpoint)
    assert train.Trainee(entry, tmp_path, most=3).planes == 3
    with pytest.raises(ValueError, match=r"checkpoint\.pt: planes: 3; expected 2 \(--planes\)"):
        train.Trainee(entry, tmp_path, most=2)
