"""What the paper does not have, planes first: competing planes, their selection, guided layers, the
choice of views, the text form of layers."""

from itertools import combinations

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity
from toy_rigs import rig_of

from liveview_ref.layer_spec import DisparityList, Guided, Planes, Select, Surface, parse
from liveview_ref.reference.competing import alphas_of, best_layer, competing_weights, composite_competing, cover_planes
from liveview_ref.reference.guided import guided_search, search_planes
from liveview_ref.reference.layers import warp_maps
from liveview_ref.reference.liveview import Camera, composite, padded_size, select_planes
from liveview_ref.reference.metrics import ssim
from liveview_ref.reference.views import choose_views, widest_parallax


def layers(count=7, size=(5, 6), seed=0, dtype=torch.float64):
    g = torch.Generator().manual_seed(seed)
    logit = torch.randn(count, *size, generator=g, dtype=dtype) * 4
    rgb = torch.rand(count, 3, *size, generator=g, dtype=dtype)
    covered = torch.rand(count, *size, generator=g) < 0.7
    covered[:, 0, 0] = False  # a pixel that no layer covers
    maps = torch.linspace(1, 0.1, count, dtype=dtype)[:, None, None].expand(-1, *size)
    return logit, rgb, covered, maps


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_weights_are_the_softmax_over_the_covered_layers(scale):
    logit, rgb, covered, maps = layers()
    found = composite_competing(logit, rgb, covered, maps, scale)
    for y in range(5):
        for x in range(6):
            terms = [
                np.exp(scale * float(a)) if c else 0.0 for a, c in zip(logit[:, y, x], covered[:, y, x], strict=True)
            ]
            weights = np.array(terms) / (sum(terms) or 1.0)
            np.testing.assert_allclose(found.weights[:, y, x].numpy(), weights, rtol=1e-12, atol=1e-300)
            np.testing.assert_allclose(found.rgb[:, y, x].numpy(), weights @ rgb[:, :, y, x].numpy(), rtol=1e-12)
            np.testing.assert_allclose(float(found.disparity[y, x]), weights @ maps[:, y, x].numpy(), rtol=1e-12)
            assert float(found.transmittance[y, x]) == (0.0 if sum(terms) else 1.0)


def test_alphas_give_the_same_picture_front_to_back():
    logit, rgb, covered, maps = layers()
    found = composite_competing(logit, rgb, covered, maps)
    # the background is opaque where covered, as in the composite: the alpha of the last covered
    # layer is 1 by itself
    mpi = composite(alphas_of(found.weights), rgb, torch.zeros_like(covered[0]), maps)
    torch.testing.assert_close(mpi.rgb, found.rgb, rtol=1e-12, atol=1e-13)
    torch.testing.assert_close(mpi.disparity, found.disparity, rtol=1e-12, atol=1e-13)
    torch.testing.assert_close(mpi.transmittance, found.transmittance, rtol=1e-12, atol=1e-12)


def test_extreme_logits_and_ties_give_finite_weights():
    covered = torch.ones(3, 1, 1, dtype=torch.bool)
    for values, expected in (
        ([3e38, -3e38, 0], [1, 0, 0]),
        ([torch.inf, torch.inf, -torch.inf], [0.5, 0.5, 0]),
        ([-3e38, -3e38, -3e38], [1 / 3] * 3),
    ):
        weights = competing_weights(torch.tensor(values)[:, None, None], covered, 4.0)
        torch.testing.assert_close(weights.flatten(), torch.tensor(expected, dtype=torch.float32))


def test_best_layer_has_the_largest_weight():
    logit, rgb, covered, maps = layers()
    found, weights = best_layer(logit, covered), competing_weights(logit, covered)
    assert torch.equal(found[covered.any(0)], weights.argmax(0)[covered.any(0)])
    assert found[0, 0] == -1
    tied = torch.tensor([1.0, 2.0, 2.0, torch.inf])[:, None, None]
    assert best_layer(tied, torch.tensor([True, True, True, False])[:, None, None]).item() == 1


def test_gradients_agree_with_finite_differences():
    logit, rgb, covered, maps = layers(4, (2, 3))
    logit.requires_grad_(), rgb.requires_grad_()
    assert torch.autograd.gradcheck(lambda a, c: composite_competing(a, c, covered, maps).rgb, (logit, rgb))


def test_guided_layers_enclose_the_surface():
    """A textured plane at depth 2: every cell's range contains its disparity within half a pixel,
    and is much smaller than the whole range."""
    images, cameras, target = rig_of("rectified")
    texture = torch.rand(3, 256, 256, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    texture = torch.nn.functional.avg_pool2d(texture[None], 5, 1, 2)[0]
    seen = []
    for camera in cameras:
        plane = torch.full((1, 45, 61), 0.5, dtype=torch.float64)
        wall = camera.with_window(-100, -100, 256, 256)
        wall = type(wall)(wall.k, target.rotation, target.translation, 256, 256)
        seen.append(warp_maps(texture, wall, camera, plane)[0][0])
    nearest, surface, farthest = guided_search(seen, cameras, target, 1.0, 8.0)
    outside = torch.maximum(0.5 - nearest, farthest - 0.5).clamp(min=0)
    scale = max(50 * float((c.centre - target.centre).norm()) for c in cameras)  # pixels per unit of disparity
    assert scale * outside.max() < 0.5
    assert (nearest - farthest).mean() < 0.05 * (1 - 1 / 8)
    assert scale * (surface - 0.5).abs().median() < 0.1


def test_first_search_has_the_given_number_of_planes():
    _, cameras, target = rig_of("random")
    assert len(search_planes(cameras, target, 1.0, 8.0, 32)) == 32
    assert 8 <= len(search_planes(cameras, target, 1.0, 8.0)) <= 128


def distance(votes, kept):
    return sum(v * min(abs(k - p) for p in kept) for k, v in enumerate(votes))


def test_cover_planes_has_the_least_total_distance():
    """The fullest bins may have a larger one."""
    histogram = torch.tensor([40, 50, 45, 0, 0, 0, 0, 9, 8, 0])
    assert select_planes(histogram, 2) == [1, 2] and cover_planes(histogram, 2) == [1, 7]
    assert cover_planes(histogram, 6) == select_planes(histogram, 6)
    rng = np.random.default_rng(0)
    for planes in range(2, 10):
        votes = rng.integers(0, 9, planes) * rng.integers(0, 2, planes)
        for count in range(1, planes):
            kept = cover_planes(torch.from_numpy(votes), count)
            assert len(kept) == count and kept == sorted(set(kept))
            assert distance(votes, kept) == min(distance(votes, some) for some in combinations(range(planes), count))


def test_chosen_views_are_the_nearest_within_60_degrees():
    _, cameras, target = rig_of("unseen")
    chosen = choose_views(cameras, target, 2)  # the other two look in other directions
    assert [float((cameras[i].centre - target.centre).norm()) for i in chosen] == sorted(
        float((c.centre - target.centre).norm()) for c in cameras if float(c.forward @ target.forward) > 0.5
    )
    with pytest.raises(ValueError, match="only 2 of 4 face the target's direction"):
        choose_views(cameras, target, 3)


def test_ssim_equals_skimages():
    generator = torch.Generator().manual_seed(0)
    a, b = torch.rand(2, 3, 40, 50, generator=generator, dtype=torch.float64)
    b = 0.7 * a + 0.3 * b
    whole = structural_similarity(
        a.numpy(), b.numpy(), channel_axis=0, data_range=1, gaussian_weights=True, sigma=1.5,
        use_sample_covariance=False, full=True,
    )[1]  # fmt: skip
    assert ssim(a, b) == pytest.approx(whole[:, 5:-5, 5:-5].mean(), abs=1e-12)


SPECS = {
    "planes:64": Planes(64),
    "guided:2": Guided(2),
    "guided:2/32": Guided(2, 32),
    "surface:2": Surface(2),
    "select:16/64": Select(16, 64),
    "list:0.5,0.25,0": DisparityList((0.5, 0.25, 0.0)),
    "list:1000000000000000000000,0.0000001": DisparityList((1e21, 1e-7)),
}


@pytest.mark.parametrize("text", SPECS)
def test_parsed_spec_formats_to_the_same_text(text):
    assert parse(text) == SPECS[text] and str(SPECS[text]) == text


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("many", "expected one like planes:64"),
        ("guided 2", "expected one like"),
        ("planes:", "not a positive whole number"),
        ("planes:0", "not a positive whole number"),
        ("planes:6/4", "not a positive whole number"),
        ("guided:2.5", "not a positive whole number"),
        ("guided:2/1", "at least 2 planes"),
        ("surface:", "not a positive whole number"),
        ("select:65", "more planes than there are"),
        ("select:16/8", "more planes than there are"),
        ("planes:-4", "not a positive whole number"),
        ("list:", "could not convert"),
        ("list:0.25,0.5", "descend"),
        ("list:0.5,0.5", "descend"),
        ("list:0.5,-1", "not negative"),
        ("list:inf,1", "finite"),
        ("list:nan", "finite"),
    ],
)
def test_invalid_spec_is_refused_with_the_reason(text, reason):
    with pytest.raises(ValueError, match=reason) as error:
        parse(text)
    assert f'layers "{text}"' in str(error.value)


@pytest.mark.parametrize("kind", ["random", "rectified", "coincident", "unseen"])
def test_widest_parallax_is_measured_between_points_of_the_world(kind):
    _, cameras, target = rig_of(kind)
    height, width = padded_size(target.height, target.width)
    corners = [(0, 0), (width, 0), (0, height), (width, height), (width / 2, height / 2)]

    def shown(camera: Camera, corner: tuple, depth: float) -> torch.Tensor | None:
        """Position in the camera of a target pixel's point; None behind the camera."""
        point = depth * torch.linalg.inv(target.k) @ torch.tensor([*corner, 1.0], dtype=torch.float64)
        world = target.rotation.T @ (point - target.translation)
        seen = camera.k @ (camera.rotation @ world + camera.translation)
        return seen[:2] / seen[2] if seen[2] > 0 else None

    for near, far in ((0.4, 0.9), (1.0, 3.3), (1.0, 1e6)):
        expected = 0.0
        for camera in cameras:
            ends = [(shown(camera, corner, near), shown(camera, corner, far)) for corner in corners]
            apart = sorted(float((a - b).norm()) for a, b in ends if a is not None and b is not None)
            expected = max(expected, apart[(len(apart) - 1) // 2] if apart else 0.0)
        assert expected > 0
        assert widest_parallax(cameras, target, near, far, (height, width)) == pytest.approx(expected, rel=1e-9)
