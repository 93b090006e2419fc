"""The stages of the library and of the reference in one process, on the same arrays: Rust's error
against float64 has the bounds of parity/tolerances.json."""

import inspect
import json

import numpy as np
import pytest
import torch
from toy_rigs import rig_of

from liveview_ref.paths import ROOT
from liveview_ref.reference.composite import composite
from liveview_ref.reference.geometry.view_selection import choose_views, view_distances
from liveview_ref.reference.image.metrics import psnr, ssim
from liveview_ref.reference.layers.cover import cover_planes
from liveview_ref.reference.layers.guided.range_map import median3
from liveview_ref.reference.layers.guided.search import guided_layers, guided_search
from liveview_ref.reference.layers.histogram import plane_histogram, select_planes
from liveview_ref.reference.layers.layer import plane_maps
from liveview_ref.reference.layers.uniform import uniform_disparities
from liveview_ref.reference.network.view_agreement import agreement_logits
from liveview_ref.reference.render.blend import blend
from liveview_ref.reference.render.composite_competing import composite_competing
from liveview_ref.reference.render.sharpened import sharpened
from liveview_ref.reference.surface.anchored_depth import anchored_depth
from liveview_ref.reference.surface.correction.exposure import exposure_gains
from liveview_ref.reference.surface.correction.sharpness import sharpening
from liveview_ref.reference.surface.fusion.confirmed_depth import ConfirmedDepth
from liveview_ref.reference.surface.fusion.consistency import confirmed
from liveview_ref.reference.surface.fusion.surface import surface
from liveview_ref.reference.surface.fusion.surface_view import SurfaceView
from liveview_ref.reference.surface.fusion.visible import visible, visible_or_past
from liveview_ref.reference.surface.neighbourhood import fill_holes
from liveview_ref.reference.surface.search.photo_depth import photo_depth
from liveview_ref.reference.warp import warp_maps

TOLERANCES = json.loads((ROOT / "parity/tolerances.json").read_text())
NEAR, FAR = 1.5, 12.0
STAGES = [
    *(agreement_logits, anchored_depth, blend, choose_views, composite, composite_competing, confirmed, cover_planes),
    *(exposure_gains, fill_holes, guided_layers, guided_search, median3, photo_depth, plane_histogram, psnr),
    *(select_planes, sharpened, sharpening, ssim, surface, uniform_disparities, view_distances, visible),
    *(visible_or_past, warp_maps),
]


@pytest.mark.parametrize("reference", STAGES, ids=lambda stage: stage.__name__)
def test_arguments_have_the_names_and_defaults_of_the_reference(liveview, reference):
    def arguments(function) -> list[tuple]:
        return [(name, found.default) for name, found in inspect.signature(function).parameters.items()]

    assert arguments(getattr(liveview, reference.__name__)) == arguments(reference)


def plain(found) -> np.ndarray:
    return np.asarray(found, np.float64)


def check(stage: str, rust, float32, float64) -> None:
    """Rust's largest and mean error are within the stage's bounds, except for doubtful elements."""
    rust, float32, float64 = plain(rust), plain(float32), plain(float64)
    bound = TOLERANCES[stage]
    errors, torchs = abs(rust - float64).ravel(), abs(float32 - float64).ravel()
    scale = abs(float64).max() if stage in ("maps", "range", "disparity", "fine_disparity") else 1
    errors, torchs = errors / scale, torchs / scale
    most = max(bound["floor"], bound["max_factor"] * torchs.max())
    mean = max(bound["mean_floor"], bound["mean_factor"] * torchs.mean()) * (1 + 1e-9)
    doubtful = bound.get("doubtful", 0)
    if doubtful == 0:
        assert errors.max() <= most and errors.mean() <= mean, (stage, errors.max(), most, errors.mean(), mean)
        return
    # Another decision, which the last bits decide, is many times the error of equal decisions.
    pixel = 1e-4 * max(abs(float64).max(), 1e-9)
    decided_otherwise = np.mean(errors > max(pixel, most))
    assert decided_otherwise <= doubtful, (stage, decided_otherwise)


def both(function, *arguments, **options):
    """The results of the reference in float32 and float64."""

    def to(value, dtype):
        if isinstance(value, torch.Tensor) and value.is_floating_point():
            return value.to(dtype)
        if isinstance(value, tuple) and hasattr(value, "_fields"):
            return type(value)(*(to(item, dtype) for item in value))
        if isinstance(value, (list, tuple)):
            return type(value)(to(item, dtype) for item in value)
        return value

    return tuple(
        function(*(to(value, dtype) for value in arguments), **options) for dtype in (torch.float32, torch.float64)
    )


@pytest.fixture(scope="module", params=["plain", "rectified", "unseen", "coincident"])
def rig(request):
    images, cameras, target = rig_of(request.param)
    maps = plane_maps(target, uniform_disparities(NEAR, FAR, 5), torch.float32).contiguous()
    return [image.float() for image in images], cameras, target, maps


def test_render_stages(liveview, rig):
    """From torch tensors, which are not copied, and cameras of the reference."""
    images, cameras, target, maps = rig
    warped = [both(warp_maps, image, camera, target, maps) for image, camera in zip(images, cameras, strict=True)]
    found = [liveview.warp_maps(image, camera, target, maps) for image, camera in zip(images, cameras, strict=True)]
    for part, stage in enumerate(("colour", "coverage")):
        single, exact = (torch.stack([of_view[dtype][part] for of_view in warped]) for dtype in (0, 1))
        check(stage, np.stack([of_view[part] for of_view in found]), single, exact)
    colour, coverage = (torch.stack([exact[part].float() for _, exact in warped], 1) for part in (0, 1))
    single, exact = both(agreement_logits, colour)
    check("agreement", liveview.agreement_logits(colour), single, exact)
    # In the network's place. On the logits of agreement Rust's mean error is up to 1.04 times
    # torch's in the coincident rig, 8e-10: a photo at the target decides nearly every pixel there.
    logits = 2 * torch.randn(coverage.shape, generator=torch.Generator().manual_seed(1))
    distances = view_distances(cameras, target)
    np.testing.assert_allclose(liveview.view_distances(cameras, target), distances, rtol=1e-13)
    for given, power in ((distances, 1.0), (distances.expand(len(maps), -1), 1.5)):
        single = blend(logits, colour, coverage, given, power)
        exact = blend(logits.double(), colour.double(), coverage.double(), given, power)
        found = liveview.blend(logits, colour, coverage, given.numpy(), power)
        check("alpha", found[0], single[0], exact[0])
        check("rgb", found[1], single[1], exact[1])
    alpha, rgb = (part.float() for part in exact)
    covered = (coverage > 0).any(1)
    for stage, opacity, seen in ((composite, alpha, covered[-1]), (composite_competing, logits[:, 0], covered)):
        single, exact = both(stage, opacity, rgb, seen, maps)
        found = getattr(liveview, stage.__name__)(opacity, rgb, seen, maps)
        check("frame", found.rgb, single.rgb, exact.rgb)
        check("disparity", found.disparity, single.disparity, exact.disparity)
        check("transmittance", found.transmittance, single.transmittance, exact.transmittance)
    histogram = plane_histogram(alpha)
    assert liveview.plane_histogram(alpha).tolist() == histogram.tolist()
    for count in (1, 2, 4, 9):
        assert liveview.select_planes(histogram, count) == select_planes(histogram, count)
        assert liveview.cover_planes(histogram, count) == cover_planes(histogram, count)


def test_warp_of_a_smaller_photo(liveview, rig):
    images, cameras, target, maps = rig
    small = torch.nn.functional.avg_pool2d(images[0][None], 2, ceil_mode=True, count_include_pad=False)[0]
    coarse = maps[:, ::2, ::2].contiguous()
    single, exact = both(warp_maps, small, cameras[0], target, coarse, 2.0)
    found = liveview.warp_maps(small, cameras[0], target, coarse, 2.0)
    check("colour", found[0], single[0], exact[0])
    check("coverage", found[1], single[1], exact[1])


def test_views_planes_and_metrics(liveview, rig):
    images, cameras, target, _ = rig
    facing = len([camera for camera in cameras if float(camera.forward @ target.forward) > 0.5])
    assert liveview.choose_views(cameras, target, facing) == choose_views(cameras, target, facing)
    expected = uniform_disparities(NEAR, np.inf, 9)
    np.testing.assert_allclose(liveview.uniform_disparities(NEAR, np.inf, 9), expected, rtol=1e-15)
    assert liveview.psnr(images[0], images[1]) == pytest.approx(psnr(images[0].double(), images[1].double()), abs=1e-6)
    assert liveview.ssim(images[0], images[1]) == pytest.approx(ssim(images[0].double(), images[1].double()), abs=1e-6)
    check("surface sharpened", liveview.sharpened(images[0], 0.1), *both(sharpened, images[0], 0.1))


def test_guided_layers(liveview):
    images, cameras, target = rig_of("plain")
    single = guided_layers([image.float() for image in images], cameras, target, NEAR, FAR, 3)
    exact = guided_layers(images, cameras, target, NEAR, FAR, 3)
    found = liveview.guided_layers([image.float() for image in images], cameras, target, NEAR, FAR, 3)
    # Without the stages in between, a decision of the search may differ at few cells.
    differs = abs(plain(found) - plain(exact)).max(0) > 1e-4
    torchs = abs(plain(single) - plain(exact)).max(0) > 1e-4
    assert differs.mean() <= max(0.02, 2 * torchs.mean()), (differs.mean(), torchs.mean())


def test_surface_stages(liveview):
    images, cameras, target = rig_of("rectified")
    views = [(image.float(), camera) for image, camera in zip(images, cameras, strict=True)]
    found = []
    for search, stage in ((photo_depth, "surface depth"), (anchored_depth, "surface anchored")):
        for which, view in enumerate(views):
            others = views[:which] + views[which + 1 :]
            single, exact = both(search, view, others, NEAR, FAR)
            rust = getattr(liveview, search.__name__)(view, others, NEAR, FAR)
            assert rust.pixel == pytest.approx(exact.pixel, rel=3e-7)
            check(stage, rust.disparity, single.disparity, exact.disparity)
            found.append(exact._replace(disparity=exact.disparity.float()))
    found = found[: len(views)]
    maps = list(zip(cameras, found, strict=True))
    sure = [confirmed(which, maps) for which in range(len(maps))]
    for which, expected in enumerate(sure):
        check("surface confirmed", liveview.confirmed(which, maps), expected, expected)
    kept = [ConfirmedDepth.of(depth, pixels) for depth, pixels in zip(found, sure, strict=True)]
    gains = torch.tensor([1.0, 1.1, 0.9])
    seen = [SurfaceView(*view, depth, gains) for view, depth in zip(views, kept, strict=True)]
    single, exact = both(surface, seen, target, NEAR, FAR)
    rust = liveview.surface(seen, target, NEAR, FAR)
    assert rust.pixel == pytest.approx(exact.pixel, rel=3e-7) and rust.holes == pytest.approx(exact.holes, abs=0.01)
    check("surface surface", rust.disparity, single.disparity, exact.disparity)
    disparity, margin = exact.disparity.float(), 4 * float(exact.pixel)
    for stage in (visible, visible_or_past):
        arguments = (cameras[0], kept[0].disparity, target, disparity, margin)
        check("surface visible", getattr(liveview, stage.__name__)(*arguments), *both(stage, *arguments))
    distances = view_distances(cameras, target)
    single = exposure_gains(seen, distances)
    exact = both(lambda views: exposure_gains(views, distances), seen)[1]
    check("surface gains", liveview.exposure_gains(seen, distances), single, exact)
    check("surface sharpening", liveview.sharpening(seen), *both(sharpening, seen))
    holes = torch.where(torch.rand(disparity.shape, generator=torch.Generator().manual_seed(1)) < 0.7, -1, disparity)
    assert np.array_equal(liveview.fill_holes(holes), fill_holes(holes))
    assert np.array_equal(liveview.median3(disparity), median3(disparity))


def test_documentation_of_the_stubs_is_that_of_the_package(liveview):
    import ast
    from pathlib import Path

    stubs = ast.parse((Path(liveview.__file__).parent / "_liveview.pyi").read_text())
    documented = 0

    def same(node, found) -> None:
        nonlocal documented
        expected = ast.get_docstring(node)
        if expected:
            documented += 1
            assert " ".join(inspect.getdoc(found).split()) == " ".join(expected.split()), node.name

    for node in stubs.body:
        if isinstance(node, ast.FunctionDef) or (isinstance(node, ast.ClassDef) and hasattr(liveview, node.name)):
            found = getattr(liveview, node.name)
            same(node, found)
            for method in getattr(node, "body", []) if isinstance(node, ast.ClassDef) else []:
                if isinstance(method, ast.FunctionDef) and not method.name.startswith("__init__"):
                    same(method, getattr(found, method.name))
    named = {node.name for node in stubs.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    assert set(liveview._liveview.__all__) <= named and documented > 60
