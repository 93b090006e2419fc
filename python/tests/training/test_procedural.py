"""Procedural scenes follow the conventions: a view warped by the target's true disparity
equals the target."""

import numpy as np
import pytest
import torch
import torch.nn.functional as F

from liveview_ref.data.procedural.photographs import defocused, jpeg, moved, phone
from liveview_ref.data.procedural.scene import Recipe, make_world, random_scene, render
from liveview_ref.data.procedural.surfaces import bars, slab
from liveview_ref.data.procedural.textures import Textures
from liveview_ref.reference.layers import warp_maps
from liveview_ref.reference.liveview import Camera


@pytest.fixture(scope="module")
def textures():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # many small operations
    yield Textures(None)
    torch.set_num_threads(threads)


def camera_of(k, r, t, image):
    k, r, t = (torch.as_tensor(x) for x in (k, r, t))
    return Camera(k, r, t, image.shape[-1], image.shape[-2])


def interior(disparity):
    """Pixels [H, W] without a step of disparity: not at an edge, where a pixel mixes two
    surfaces."""
    high = F.max_pool2d(disparity[None], 3, 1, 1)[0]
    low = -F.max_pool2d(-disparity[None], 3, 1, 1)[0]
    return high - low < 0.06 * high


@pytest.mark.parametrize("recipe", [Recipe(), Recipe(rooms=1.0)], ids=["things", "rooms"])
def test_unoccluded_views_reproject_onto_the_target(textures, recipe):
    errors, wrong = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        world = make_world(rng, 3, (64, 80), recipe)
        images, disparities = render(rng, world, textures, recipe)
        assert all(bool((d > 0).all()) for d in disparities), "a pixel shows nothing"
        cameras = [camera_of(*c) for c in zip(world.k, world.r, world.t, images, strict=True)]
        inside = interior(disparities[0])
        x, y = torch.meshgrid(torch.arange(80) + 0.5, torch.arange(64) + 0.5, indexing="xy")
        points = torch.linalg.inv(cameras[0].k) @ torch.stack([x, y, torch.ones_like(x)]).double().reshape(3, -1)
        points = points / disparities[0].reshape(1, -1)
        for v in range(1, 4):
            image, disparity, view = images[v], disparities[v], cameras[v]
            colour, coverage = warp_maps(image, view, cameras[0], disparities[0][None])
            depth = (torch.from_numpy(world.r[v]) @ points + torch.from_numpy(world.t[v])[:, None])[2]
            expected = 1 / depth.reshape(64, 80)
            both = torch.stack([disparity, interior(disparity).float(), disparity * 0])
            there, _ = warp_maps(both, view, cameras[0], disparities[0][None])
            visible = (
                inside & (coverage[0] > 0.999) & (there[0, 1] > 0.999) & ((there[0, 0] / expected - 1).abs() < 0.05)
            )
            if visible.sum() < 100:
                continue
            error = (colour[0] - images[0]).abs().mean(0)[visible]
            errors.append(float(error.mean()))
            wrong.append(float((colour[0].roll(2, 2) - images[0]).abs().mean(0)[visible].mean()))
    assert len(errors) > 24, "hardly any view sees the target's surfaces"
    assert np.mean(errors) < 0.02 and np.median(errors) < 0.015, errors
    assert np.mean(wrong) > 2 * np.mean(errors), "a shift by two pixels passes as well: the check is too weak"


def test_scene_follows_the_conventions_after_its_rigid_motion_and_scaling(textures):
    medians = []
    for seed in range(8):
        s = random_scene(np.random.default_rng(seed), 3, (64, 80), textures)
        assert s.target.shape == (3, 64, 80) and s.disparity.shape == (64, 80)
        assert s.disparity.min() >= 1 / s.far and s.disparity.max() <= 1 / s.near
        for view, camera in zip(s.views, s.cameras, strict=True):
            assert view.dtype == torch.float32 and view.min() >= 0 and view.max() <= 1
            torch.testing.assert_close(camera.rotation @ camera.rotation.T, torch.eye(3, dtype=torch.float64))
            colour, coverage = warp_maps(view, camera, s.target_camera, s.disparity[None])
            covered = coverage[0] > 0.999
            if covered.sum() > 500:
                medians.append(float((colour[0] - s.target).abs().mean(0)[covered].median()))
    assert np.median(medians) < 0.03, medians


@pytest.mark.parametrize("recipe", [Recipe(), Recipe(rooms=1.0, phones=1.0)], ids=["things", "rooms"])
def test_seed_determines_the_scene(textures, recipe):
    first, second = (random_scene(np.random.default_rng(3), 4, (64, 64), textures, recipe) for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(first.views, second.views, strict=True))
    assert torch.equal(first.target, second.target)
    pairs = zip(first.cameras, second.cameras, strict=True)
    assert all(torch.equal(a.translation, b.translation) for a, b in pairs)


def test_thin_bars_cover_their_share_of_a_pixel(textures):
    x = torch.linspace(-3, 3, 601)
    assert bars(x, 1.0, 0.25, torch.full_like(x, 7.0)).sub(0.25).abs().max() < 0.04
    assert abs(float(slab(x, 0.05, torch.full_like(x, 1.0)).sum()) * 0.01 - 0.1) < 2e-3


def test_a_phone_changes_every_view_a_little():
    rng = np.random.default_rng(2)
    view = F.interpolate(torch.rand(1, 3, 12, 16), (48, 64), mode="bilinear")[0]
    changed = phone(rng, [view, view], [torch.full((48, 64), 0.5)] * 2)
    for photo in changed:
        assert photo.shape == view.shape and photo.min() >= 0 and photo.max() <= 1
        assert 1e-3 < (photo - view).abs().mean() < 0.1
    assert not torch.equal(*changed)


def test_blur_spreads_a_point_where_and_as_far_as_it_should():
    point = torch.zeros(3, 33, 33)
    point[:, 16, 16] = 1
    across = moved(point, 6.0, 0.0)
    assert across[0, 16, 12:21].sum() == pytest.approx(1, abs=1e-5) and across[0, 16, 13] > 0.1
    assert across[0, 12].sum() < 1e-6
    for share, reach in ((0.0, 0), (1 / 3, 1), (1.0, 3)):
        blurred = defocused(point, torch.full((33, 33), share), 3.0)[0]
        inside = blurred[16 - reach : 17 + reach, 16 - reach : 17 + reach]
        assert inside.sum() == pytest.approx(1, abs=1e-5) and inside.min() > 1e-4


def test_jpeg_of_low_quality_is_farther_off():
    view = torch.rand(3, 32, 40)
    fine, coarse = ((jpeg(view, quality) - view).abs().mean() for quality in (95, 30))
    assert 0 < fine < coarse < 0.3
