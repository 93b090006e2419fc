"""The reference against kornia, figures computed by hand, and the paper's counts."""

import math
from itertools import combinations, pairwise

import numpy as np
import onnx
import pytest
import torch
from skimage.metrics import structural_similarity
from toy_rigs import rig_of

from liveview_ref.checkpoint import load_network
from liveview_ref.export import check, export
from liveview_ref.parity.kornia_warp import warp_plane_kornia
from liveview_ref.reference.composite import composite
from liveview_ref.reference.geometry.camera import Camera
from liveview_ref.reference.geometry.view_selection import choose_views
from liveview_ref.reference.image.metrics import ssim
from liveview_ref.reference.layers.cells import padded_size
from liveview_ref.reference.layers.cover import cover_planes
from liveview_ref.reference.layers.guided.search import guided_search, search_planes
from liveview_ref.reference.layers.histogram import plane_histogram, select_planes
from liveview_ref.reference.layers.layer import plane_maps
from liveview_ref.reference.layers.uniform import uniform_disparities
from liveview_ref.reference.render.blend import blend
from liveview_ref.reference.render.renderer import render
from liveview_ref.reference.render.spacing import LEAST_SPACING, spacing
from liveview_ref.reference.unet import UNet, adapt_views, fold_batchnorm, start_from_agreement
from liveview_ref.reference.warp import warp_maps


@pytest.mark.parametrize("kind", ["random", "rectified", "coincident", "unseen"])
def test_spacing_is_the_parallax_from_each_plane_to_the_next(kind):
    _, cameras, target = rig_of(kind)
    planes = torch.tensor([2.5, 1.1, 1.0, 0.99, 0.99, 0.3, 0.0], dtype=torch.float64)
    found = spacing(cameras, target, planes, 5.0)
    height, width = padded_size(target.height, target.width)
    corners = [(0, 0), (width, 0), (0, height), (width, height), (width / 2, height / 2)]

    def shown(camera: Camera, corner: tuple, disparity: torch.Tensor) -> torch.Tensor | None:
        """Position in the camera of a target pixel's point, computed in world coordinates; None
        behind the camera."""
        ray = torch.linalg.inv(target.k) @ torch.tensor([*corner, 1.0], dtype=torch.float64)
        from_target = camera.rotation @ target.rotation.T
        point = camera.k @ (from_target @ (ray - disparity * target.translation) + disparity * camera.translation)
        return point[:2] / point[2] if point[2] > 0 else None

    expected = []
    for near, far in pairwise(planes):
        largest = 0.0
        for camera in cameras:
            ends = [(shown(camera, corner, near), shown(camera, corner, far)) for corner in corners]
            apart = sorted(float((a - b).norm()) for a, b in ends if a is not None and b is not None)
            largest = max(largest, apart[(len(apart) - 1) // 2] if apart else 0.0)
        expected.append(min(max(largest, LEAST_SPACING), 5.0))
    torch.testing.assert_close(found, torch.tensor([*expected, expected[-1]], dtype=torch.float64))
    assert expected[3] == LEAST_SPACING and max(expected) == 5.0
    assert spacing(cameras, target, planes[:1], 5.0).tolist() == [5.0]


@pytest.mark.parametrize("kind", ["random", "rectified", "coincident", "unseen"])
@pytest.mark.parametrize("disparity", [0.0, 0.3, 1.0, 1.6])
def test_warp_equals_kornias_homography_warp(kind, disparity):
    """In float64, also for points behind the camera."""
    for image, camera, target in zip(*rig_of(kind)[:2], [rig_of(kind)[2]] * 4, strict=True):
        size = (target.height, target.width)
        maps = torch.full((1, *size), disparity, dtype=torch.float64)
        colour, coverage = warp_maps(image, camera, target, maps)
        expected = warp_plane_kornia(image, camera, target, disparity, size)
        torch.testing.assert_close(colour[0], expected[0], rtol=0, atol=1e-11)
        torch.testing.assert_close(coverage[0], expected[1], rtol=0, atol=1e-11)


def test_points_behind_a_camera_are_not_covered():
    """kornia alone would sample them mirrored."""
    images, cameras, target = rig_of("unseen")
    away = next(i for i, c in enumerate(cameras) if float(c.forward @ target.forward) < -0.9)
    maps = torch.full((1, target.height, target.width), 0.05, dtype=torch.float64)
    assert warp_maps(images[away], cameras[away], target, maps)[1].max() == 0


def test_huge_and_non_finite_coordinates_are_outside():
    images, cameras, target = rig_of("random")
    maps = torch.tensor([1e300, math.nan, math.inf], dtype=torch.float64)[:, None, None].expand(3, 8, 8)
    colour, coverage = warp_maps(images[0], cameras[0], target, maps)
    assert torch.isfinite(colour).all() and coverage[1:].abs().max() == 0


def test_network_has_the_parameters_of_the_paper():
    net = UNet(4)
    count = sum(p.numel() for name, p in net.named_parameters() if p.dim() == 4)
    assert count == 391_680
    assert net(torch.zeros(2, 12, 16, 24)).shape == (2, 4, 16, 24)


def test_folding_batchnorm_keeps_the_logits():
    torch.manual_seed(0)
    net = UNet(2)
    net(torch.rand(4, 6, 32, 32))  # changes the running statistics
    hwv = torch.rand(3, 6, 24, 40)
    net.eval()
    torch.testing.assert_close(fold_batchnorm(net)(hwv), net(hwv), rtol=1e-4, atol=1e-5)


def test_network_adapted_to_more_views_gives_the_logits_of_its_start_whatever_the_others_show():
    torch.manual_seed(0)
    source, wider = UNet(4).eval(), UNet(10).eval()
    adapt_views(source.state_dict(), wider)
    hwv = torch.rand(2, 30, 16, 16)
    before, after = source(hwv[:, :12]), wider(hwv)
    torch.testing.assert_close(after[:, :4], before)
    torch.testing.assert_close(after[:, 4:], (before[:, 3:] - 2.0).expand(-1, 6, -1, -1))


def test_network_adapted_to_fewer_views_gives_the_same_for_photos_that_agree():
    torch.manual_seed(0)
    source, narrower = UNet(4).eval(), UNet(2).eval()
    adapt_views(source.state_dict(), narrower)
    photo = torch.rand(1, 3, 16, 16)
    torch.testing.assert_close(narrower(photo.repeat(1, 2, 1, 1)), source(photo.repeat(1, 4, 1, 1))[:, :2])


def test_exported_model_is_a_single_checked_graph(tmp_path):
    torch.manual_seed(3)
    net = UNet(3)
    start_from_agreement(net)
    net(torch.rand(4, 9, 32, 32))
    net.eval()
    path = tmp_path / "model.onnx"
    export(net, path, {"licence": "none"})
    assert check(net, path) < 1e-5
    model = onnx.load(path, load_external_data=False)
    operators = sorted(node.op_type for node in model.graph.node)
    assert operators == ["Concat"] * 3 + ["Conv"] * 9 + ["Relu"] * 8 + ["Resize"] * 3
    assert not list(tmp_path.glob("*.data")) and model.opset_import[0].version == 20
    hwv = torch.rand(1, 9, 16, 16)
    torch.testing.assert_close(load_network(path)(hwv), net(hwv), rtol=1e-4, atol=1e-5)


def test_blend_equals_values_computed_by_hand():
    colour = torch.tensor([0.2, 0.6]).reshape(1, 2, 1, 1, 1).expand(1, 2, 3, 1, 1)
    ones = torch.ones(1, 2, 1, 1)
    alpha, rgb = blend(torch.zeros(1, 2, 1, 1), colour, ones, torch.tensor([1.0, 3.0]))
    assert alpha.item() == 0.5
    torch.testing.assert_close(rgb[0, 0, 0, 0], torch.tensor(0.75 * 0.2 + 0.25 * 0.6))
    _, rgb = blend(torch.full((1, 2, 1, 1), 9.0), colour, ones, torch.tensor([0.0, 3.0]))
    torch.testing.assert_close(rgb[0, 0, 0, 0], torch.tensor(0.2))  # at the first view's place


def test_view_that_does_not_cover_a_pixel_does_not_darken_it():
    coverage = torch.tensor([1e-6, 0.0]).reshape(1, 2, 1, 1)
    colour = coverage[:, :, None] * 0.5 * torch.ones(1, 2, 3, 1, 1)
    _, rgb = blend(torch.zeros(1, 2, 1, 1), colour, coverage, torch.ones(2))
    torch.testing.assert_close(rgb, torch.full_like(rgb, 0.5))


def test_composite_equals_values_computed_by_hand():
    alpha = torch.tensor([0.0, 0.3, 0.8, 0.5])[:, None, None]
    out = composite(alpha, torch.ones(4, 3, 1, 1), torch.zeros(1, 1, dtype=torch.bool), torch.ones(4, 1, 1))
    torch.testing.assert_close(out.weights.flatten(), torch.tensor([0.0, 0.3, 0.56, 0.07]))
    torch.testing.assert_close(out.transmittance.flatten(), torch.tensor([0.07]))
    out = composite(alpha, torch.ones(4, 3, 1, 1), torch.ones(1, 1, dtype=torch.bool), torch.ones(4, 1, 1))
    assert out.transmittance.item() == 0 and out.rgb.max().item() == pytest.approx(1)


def test_selection_takes_the_fullest_bins_and_the_nearer_of_ties():
    alpha = torch.tensor([[0.1, 0.9, 0.2, 0.0], [0.5, 0.9, 0.1, 0.0], [0.2, 0.1, 0.3, 0.0]])[:, None]
    histogram = plane_histogram(alpha)
    assert histogram.tolist() == [1, 1, 1]
    assert select_planes(histogram, 2) == [0, 1]


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


def test_first_search_has_the_given_number_of_planes():
    _, cameras, target = rig_of("random")
    assert len(search_planes(cameras, target, 1.0, 8.0, 32)) == 32
    assert 8 <= len(search_planes(cameras, target, 1.0, 8.0)) <= 128


def test_uniform_planes_end_at_disparity_0_for_infinite_far():
    assert uniform_disparities(0.5, math.inf, 3).tolist() == [2.0, 1.0, 0.0]


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


def test_scene_of_one_plane_does_not_depend_on_the_network():
    """With a single plane, the background, any alpha gives the same picture."""
    images, cameras, target = rig_of("coincident")
    maps = plane_maps(target, torch.tensor([0.4]), torch.float64)
    out, parts = render(lambda hwv: torch.randn(len(hwv), 4, *hwv.shape[2:]).double(), images, cameras, target, maps)
    seen = parts.coverage[0, 0, :38, :53] > 0
    expected = parts.colour[0, 0, :, :38, :53] / parts.coverage[0, 0, :38, :53].clamp(min=1e-300)
    torch.testing.assert_close(out.rgb[:, seen], expected[:, seen])


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
