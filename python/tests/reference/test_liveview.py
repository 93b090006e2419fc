"""The paper (reference/liveview.py) against cases worked by hand and against grid_sample; the
weights of its network."""

import math

import onnx
import pytest
import torch
from toy_rigs import rig_of

from liveview_ref.checkpoint import load_network
from liveview_ref.export import check, export
from liveview_ref.reference.layers import plane_maps, warp_maps
from liveview_ref.reference.liveview import (
    Camera,
    UNet,
    blend,
    composite,
    kornia_samples,
    padded_size,
    plane_histogram,
    render,
    select_planes,
    uniform_disparities,
    warp,
)
from liveview_ref.weights import adapt_views, fold_batchnorm, start_from_agreement

KINDS = ["random", "rectified", "coincident", "unseen"]


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("disparity", [0.0, 0.3, 1.0, 1.6])
def test_warp_by_kornia_equals_grid_sample(kind, disparity, dtype):
    """Also for points behind the camera."""
    images, cameras, target = rig_of(kind)
    maps = plane_maps(target, torch.tensor([disparity], dtype=torch.float64), dtype)
    for image, camera in zip(images, cameras, strict=True):
        colour, coverage = warp(image.to(dtype), camera, target, disparity)
        expected = warp_maps(image.to(dtype), camera, target, maps)
        assert colour.dtype == dtype and colour.shape[1:] == padded_size(target.height, target.width)
        bound = 1e-11 if dtype == torch.float64 else 5e-5
        torch.testing.assert_close(colour, expected[0][0], rtol=0, atol=bound)
        torch.testing.assert_close(coverage, expected[1][0], rtol=0, atol=bound)


def test_warp_by_whole_pixels_shifts_the_photo():
    """A camera 0.1 to the right with a focal length of 10 sees a plane at depth 0.5 two pixels
    further left."""
    k = torch.tensor([[10.0, 0, 4], [0, 10, 4], [0, 0, 1]], dtype=torch.float64)
    still, eye = torch.zeros(3, dtype=torch.float64), torch.eye(3, dtype=torch.float64)
    target = Camera(k, eye, still, 8, 8)
    right = Camera(k, eye, torch.tensor([-0.1, 0, 0], dtype=torch.float64), 8, 8)
    photo = torch.rand(3, 8, 8, dtype=torch.float64)
    colour, coverage = warp(photo, right, target, 2.0)
    torch.testing.assert_close(colour[:, :, 2:], photo[:, :, :-2])
    torch.testing.assert_close(coverage, (torch.arange(8) >= 2).double().expand(8, 8))


def test_points_behind_a_camera_are_not_covered():
    """kornia alone samples them, mirrored."""
    images, cameras, target = rig_of("unseen")
    away = next(i for i, c in enumerate(cameras) if float(c.forward @ target.forward) < -0.9)
    photo, camera = images[away], cameras[away]
    assert kornia_samples(photo, camera, target, 0.05, (40, 56))[3].max() == 1
    assert warp(photo, camera, target, 0.05)[1].max() == 0
    assert warp_maps(photo, camera, target, torch.full((1, 40, 56), 0.05, dtype=torch.float64))[1].max() == 0


def test_huge_and_non_finite_coordinates_are_outside():
    images, cameras, target = rig_of("random")
    disparities = torch.tensor([1e300, math.nan, math.inf], dtype=torch.float64)
    colour, coverage = warp_maps(images[0], cameras[0], target, plane_maps(target, disparities, torch.float64))
    assert torch.isfinite(colour).all() and coverage[1:].abs().max() == 0
    for disparity, expected in zip(disparities, coverage, strict=True):
        colour, found = warp(images[0], cameras[0], target, float(disparity))
        assert torch.isfinite(colour).all() and torch.equal(found, expected)


def test_network_has_the_parameters_of_the_paper():
    net = UNet(4)
    count = sum(p.numel() for name, p in net.named_parameters() if p.dim() == 4)
    assert count == 391_680
    assert net(torch.zeros(2, 12, 16, 24)).shape == (2, 4, 16, 24)


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


def test_uniform_planes_end_at_disparity_0_for_infinite_far():
    assert uniform_disparities(0.5, math.inf, 3).tolist() == [2.0, 1.0, 0.0]


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_picture_of_one_plane_does_not_depend_on_the_network(dtype):
    """With a single plane, the background, any alpha gives the same picture; here that of the view
    at the target."""
    images, cameras, target = rig_of("coincident")
    out, parts = render(
        lambda hwv: torch.randn(len(hwv), 4, *hwv.shape[2:], dtype=dtype),
        [image.to(dtype) for image in images],
        cameras,
        target,
        torch.tensor([0.4], dtype=torch.float64),
    )
    seen = parts.coverage[0, 0, :38, :53] > 0
    expected = parts.colour[0, 0, :, :38, :53] / parts.coverage[0, 0, :38, :53].clamp(min=1e-30)
    torch.testing.assert_close(out.rgb[:, seen], expected[:, seen])


def test_picture_is_the_sum_over_its_planes():
    """Pixel by pixel: sigmoid, the front planes' transmittance, an opaque background."""
    images, cameras, target = rig_of("random")
    planes = uniform_disparities(1.0, math.inf, 3)
    out, parts = render(UNet(4).double().eval().requires_grad_(False), images, cameras, target, planes)
    alpha = torch.sigmoid(parts.logits[:, 0]) * (parts.coverage > 0).any(1)
    torch.testing.assert_close(parts.alpha, alpha)
    near, middle = alpha[0], (1 - alpha[0]) * alpha[1]
    far = torch.where((parts.coverage[2] > 0).any(0), (1 - alpha[0]) * (1 - alpha[1]), 0)
    expected = near * parts.rgb[0] + middle * parts.rgb[1] + far * parts.rgb[2]
    torch.testing.assert_close(out.rgb, expected[:, : target.height, : target.width])
    torch.testing.assert_close(out.disparity, (near + middle * 0.5)[: target.height, : target.width])


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
