"""The stages of the library and of the reference in one process, on the same arrays: Rust's error
against float64 has the bounds of parity/tolerances.json. Surface layers: test_surface_stages.py;
what is inside these stages: test_inner_stages.py."""

import inspect
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from compared_cases import both, case_of, check
from hostile_cases import Cases
from toy_rigs import rig_of

from liveview_ref.parity import stage_cases, stages
from liveview_ref.reference.competing import composite_competing, cover_planes
from liveview_ref.reference.guided import guided_layers, guided_search, median3
from liveview_ref.reference.layers import plane_maps, warp_maps
from liveview_ref.reference.liveview import (
    Camera,
    blend,
    composite,
    plane_histogram,
    select_planes,
    uniform_disparities,
    view_distances,
)
from liveview_ref.reference.metrics import psnr, ssim
from liveview_ref.reference.surface.anchored_depth import anchored_depth
from liveview_ref.reference.surface.correction import exposure_gains, sharpened, sharpening
from liveview_ref.reference.surface.fusion import SurfaceView, confirmed, visible, visible_or_past
from liveview_ref.reference.surface.photo_depth import PhotoDepth, photo_depth
from liveview_ref.reference.surface.target_surface import fill_holes, surface
from liveview_ref.reference.view_agreement import agreement_logits
from liveview_ref.reference.views import choose_views

NEAR, FAR = 1.5, 12.0

torch.set_num_threads(1)  # small arrays

STAGES = [
    *(agreement_logits, anchored_depth, blend, choose_views, composite, composite_competing, confirmed, cover_planes),
    *(exposure_gains, fill_holes, guided_layers, guided_search, median3, photo_depth, plane_histogram, psnr),
    *(select_planes, sharpened, sharpening, ssim, surface, uniform_disparities, view_distances, visible),
    *(visible_or_past, warp_maps),
]


def test_every_stage_of_the_package_is_compared(liveview):
    exported = {name for name in liveview.__all__ if inspect.isroutine(getattr(liveview, name))}
    assert exported == {stage.__name__ for stage in STAGES}


@pytest.mark.parametrize("reference", STAGES, ids=lambda stage: stage.__name__)
def test_only_the_import_differs_from_the_reference(liveview, reference):
    """Arguments, their defaults, and what comes back for the same objects."""
    stage = getattr(liveview, reference.__name__)

    def arguments(function) -> list[tuple]:
        return [(name, found.default) for name, found in inspect.signature(function).parameters.items()]

    assert arguments(stage) == arguments(reference)
    given = of_reference(liveview, Cases(liveview).good[reference.__name__])
    found, expected = stage(**given), reference(**given)
    assert structure(found) == structure(expected)
    if type(expected).__module__.startswith("liveview_ref"):  # its methods
        assert public(expected) <= public(found)


def public(found) -> set[str]:
    return {name for name in dir(found) if not name.startswith("_")}


def of_reference(liveview, value):
    """Arguments of the package as the reference's types."""
    if isinstance(value, np.ndarray) or (isinstance(value, list) and isinstance(value[0], (int, float))):
        return torch.as_tensor(value)
    if isinstance(value, liveview.Camera):
        parts = (torch.from_numpy(part) for part in (value.k, value.rotation, value.translation))
        return Camera(*parts, value.width, value.height)
    if isinstance(value, SimpleNamespace):
        return SurfaceView(**of_reference(liveview, vars(value)))
    if isinstance(value, liveview.PhotoDepth):
        return PhotoDepth(*(of_reference(liveview, item) for item in value))
    if isinstance(value, dict):
        return {name: of_reference(liveview, item) for name, item in value.items()}
    return type(value)(of_reference(liveview, item) for item in value) if isinstance(value, (list, tuple)) else value


def structure(found):
    """Names of fields, shapes, and kinds of numbers."""
    if isinstance(found, (np.ndarray, torch.Tensor)):
        return tuple(found.shape), np.asarray(found).dtype.kind
    names = getattr(found, "_fields", None) or getattr(found, "__dataclass_fields__", None)
    if names:
        return [(name, structure(getattr(found, name))) for name in names]
    return (type(found), [structure(item) for item in found]) if isinstance(found, (list, tuple)) else type(found)


@pytest.fixture(scope="module", params=stage_cases.CASES)
def case(request):
    return case_of(request.param)


def test_warp_and_agreement(liveview, case):
    """From torch tensors, which are not copied, and cameras of the reference."""
    photos = zip(case.images, case.cameras, strict=True)
    found = [liveview.warp_maps(image, camera, case.target, case.maps) for image, camera in photos]
    colour, coverage = (np.stack(part, 1) for part in zip(*found, strict=True))
    case.check(stages.warp, colour=colour.reshape(case.data["colour"].shape), coverage=coverage)
    case.check(stages.agreement, agreement=liveview.agreement_logits(case.colour))


def test_blend(liveview, case):
    if "logit_shift" in case.data:
        pytest.skip("test_inner_stages.py: the shift is an argument of the library's blend, not of the reference's")
    distances = view_distances(case.cameras, case.target)
    # Either side rounds both centres of a distance, in three products and sums each: by at most
    # 3 sqrt(3) / 2 eps of their length, 10.4 eps in all.
    rounding = 12 * np.finfo(np.float64).eps * max(float(camera.centre.norm()) for camera in case.cameras)
    found = liveview.view_distances(case.cameras, case.target)
    np.testing.assert_allclose(found, distances, rtol=1e-13, atol=rounding)
    alpha, rgb = liveview.blend(case.logits, case.colour, case.coverage, distances)
    case.check(stages.blended, alpha=alpha, rgb=rgb)
    of_each = distances.expand(len(case.maps), -1)
    exact, single = both(lambda *parts: blend(*parts, of_each, 1.5), case.logits, case.colour, case.coverage)
    found = liveview.blend(case.logits, case.colour, case.coverage, of_each, 1.5)
    for name, *parts in zip(("alpha", "rgb"), found, exact, single, strict=True):
        check(name, *parts)


def test_composite_and_selection(liveview, case):
    if "alpha_scale" in case.data:
        scale = float(case.data["alpha_scale"][0])
        stage, arguments = composite_competing, (case.logits[:, 0], case.rgb, case.covered, case.maps)
    else:
        scale, stage, arguments = None, composite, (case.alpha, case.rgb, case.covered[-1], case.maps)
    options = {} if scale is None else {"scale": scale}
    found = getattr(liveview, stage.__name__)(*arguments, **options)
    crop = (..., slice(case.target.height), slice(case.target.width))
    cropped = {"frame": found.rgb, "disparity": found.disparity, "transmittance": found.transmittance}
    case.check(stages.composited, **{name: part[crop] for name, part in cropped.items()})
    exact, single = both(stage, *arguments, **options)
    check("frame", found.weights, exact.weights, single.weights)
    best = stages.best_layer(case.data)
    expected = np.bincount(best[best >= 0], minlength=len(case.maps))
    opacity = case.alpha if scale is None else torch.from_numpy(found.weights)
    histogram = torch.from_numpy(liveview.plane_histogram(opacity[crop]))
    assert histogram.tolist() == expected.tolist() and plane_histogram(opacity[crop]).tolist() == expected.tolist()
    for count in (1, 2, 4, 20):
        assert liveview.select_planes(histogram, count) == select_planes(histogram, count)
        assert liveview.cover_planes(histogram, count) == cover_planes(histogram, count)


@pytest.mark.parametrize("kind", ["plain", "rectified", "unseen", "coincident"])
def test_warp_of_a_smaller_photo(liveview, kind):
    images, cameras, target = rig_of(kind)
    maps = plane_maps(target, uniform_disparities(NEAR, FAR, 5), torch.float32)[:, ::2, ::2]
    small = torch.nn.functional.avg_pool2d(images[0][None], 2, ceil_mode=True, count_include_pad=False)[0].float()
    exact, single = both(warp_maps, small, cameras[0], target, maps, 2.0)
    found = liveview.warp_maps(small, cameras[0], target, maps, 2.0)
    for name, *parts in zip(("colour", "coverage"), found, exact, single, strict=True):
        check(name, *parts)


def test_views_planes_and_metrics(liveview, case):
    facing = len([camera for camera in case.cameras if float(camera.forward @ case.target.forward) > 0.5])
    expected = choose_views(case.cameras, case.target, facing)
    assert liveview.choose_views(case.cameras, case.target, facing) == expected
    expected = uniform_disparities(NEAR, np.inf, 9)
    np.testing.assert_allclose(liveview.uniform_disparities(NEAR, np.inf, 9), expected, rtol=1e-15)
    first, second = case.images[:2]
    assert liveview.psnr(first, second) == pytest.approx(psnr(first.double(), second.double()), abs=1e-6)
    assert liveview.ssim(first, second) == pytest.approx(ssim(first.double(), second.double()), abs=1e-6)
    check("surface sharpened", liveview.sharpened(first, 0.1), *both(sharpened, first, 0.1))


def test_guided_layers(liveview):
    images, cameras, target = rig_of("plain")
    single = guided_layers([image.float() for image in images], cameras, target, NEAR, FAR, 3)
    exact = guided_layers(images, cameras, target, NEAR, FAR, 3)
    found = liveview.guided_layers([image.float() for image in images], cameras, target, NEAR, FAR, 3)
    # Without the stages in between, a decision of the search may differ at few cells.
    differs = abs(found - exact.numpy()).max(0) > 1e-4
    torchs = abs(single - exact).max(0).values > 1e-4
    assert differs.mean() <= max(0.02, 2 * float(torchs.double().mean())), differs.mean()


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
    assert set(liveview._liveview.__all__) - {"_stages"} <= named and documented > 60
