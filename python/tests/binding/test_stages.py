"""The stages of the library and of the reference in one process, on the same arrays: Rust's error
against float64 has the bounds of parity/tolerances.json."""

import inspect
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hostile_cases import Cases
from toy_rigs import rig_of

from liveview_ref import onnx_session
from liveview_ref.export import export
from liveview_ref.parity.compared import row, rows
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
from liveview_ref.reference.surface.photo_depth import PhotoDisparity, photo_depth
from liveview_ref.reference.surface.target_surface import Surface, fill_holes, surface
from liveview_ref.reference.view_agreement import agreement_logits
from liveview_ref.reference.views import choose_views

pytest.importorskip("liveview_ref.extension", exc_type=ImportError)
import compared_cases as cases  # noqa: E402
from compared_cases import CASES, SURFACE_CASES  # noqa: E402

from liveview_ref.parity import stages  # noqa: E402

NEAR, FAR = 1.5, 12.0
ARRAYS = "maps", "logits", "coverage", "alpha", "rgb"
MOST_DIFFERENT = 1e-4  # of the final frames of Rust, of float32 torch and of the oracle, in [0, 1]

torch.set_num_threads(1)  # small arrays

STAGES = [
    *(agreement_logits, anchored_depth, blend, choose_views, composite, composite_competing, confirmed, cover_planes),
    *(exposure_gains, fill_holes, guided_layers, guided_search, median3, photo_depth, plane_histogram, psnr),
    *(select_planes, sharpened, sharpening, ssim, surface, uniform_disparities, view_distances, visible),
    *(visible_or_past, warp_maps),
]


def test_every_stage_of_the_package_is_compared(liveview):
    exported = {name for name in liveview.__all__ if inspect.isroutine(getattr(liveview, name))}
    assert exported - {"bake", "poses", "undistort"} == {stage.__name__ for stage in STAGES}


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
    if isinstance(value, liveview.PhotoDisparity):
        return PhotoDisparity(*(of_reference(liveview, item) for item in value))
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


@pytest.fixture(scope="module")
def models(tmp_path_factory) -> dict[int, Path]:
    """A seeded, untrained network for each V. The oracle's has its BatchNorms, in the exported one
    they are folded."""
    folder, found = tmp_path_factory.mktemp("models"), {}
    for views in {views for views, *_ in CASES.values()}:
        found[views] = folder / f"network_v{views}.onnx"
        about = {"recommended_layers": "guided:4", "training": "none: seeded", "licence": "MIT"}
        export(cases.network(views).float(), found[views], about)
    return found


@pytest.fixture(scope="module", params=CASES)
def case(liveview, models, request) -> tuple[stages.Rig, dict[str, np.ndarray], Path]:
    """A rig, every stage of its picture by the package, and the model."""
    model = models[CASES[request.param][0]]
    return *cases.rendered(request.param, model), model


def assert_within_bounds(found) -> set[str]:
    """The names of the rows, none of which departs."""
    names = set()
    for one in found:
        assert not one.departs, one.row()
        names.add(one.name)
    return names


def test_every_stage_of_a_picture(case):
    rig, data, model = case
    assert_within_bounds(cases.rows(rig, data))
    assert np.array_equal(stages.best_layer(data), data["best_layer"])
    expected = onnx_session.logits(onnx_session.session(model, 1), data["colour"])
    assert data["logits"].tobytes() == expected.tobytes()


@pytest.mark.parametrize("name", CASES)
def test_picture_for_any_batch_size(liveview, models, name):
    model = models[CASES[name][0]]
    (rig, one), (_, three) = (cases.rendered(name, model, batch) for batch in (1, 3))
    assert all(np.array_equal(value, three[name]) for name, value in one.items())
    for dtype in (torch.float32, torch.float64):
        frame = cases.end_to_end(rig, one, dtype)
        assert np.abs(one["frame"] - frame.numpy()).max() <= MOST_DIFFERENT, dtype


def test_stages_alone_give_the_same_arrays(liveview, case):
    """From torch tensors, which are not copied, and cameras of the reference."""
    (images, cameras, target), data, _ = case
    maps, logits, coverage, alpha, rgb = map(torch.from_numpy, (data[name] for name in ARRAYS))
    photos = zip(images, cameras, strict=True)
    found = [liveview.warp_maps(image, camera, target, maps) for image, camera in photos]
    colour, covered = (np.stack(part, 1) for part in zip(*found, strict=True))
    assert np.array_equal(colour.reshape(data["colour"].shape), data["colour"])
    assert np.array_equal(covered, data["coverage"])
    distances = liveview.view_distances(cameras, target)
    # Either side rounds both centres of a distance, in three products and sums each: by at most
    # 3 sqrt(3) / 2 eps of their length, 10.4 eps in all.
    rounding = 12 * np.finfo(np.float64).eps * max(float(camera.centre.norm()) for camera in cameras)
    np.testing.assert_allclose(distances, view_distances(cameras, target), rtol=1e-13, atol=rounding)
    found = liveview.blend(logits, colour, coverage, distances)
    assert all(np.array_equal(*pair) for pair in zip(found, (data["alpha"], data["rgb"]), strict=True))
    of_each = np.tile(distances, (len(maps), 1))
    found = liveview.blend(logits, colour, coverage, of_each, 1.5)
    reference = lambda *parts: blend(*parts, torch.from_numpy(of_each), 1.5)  # noqa: E731
    assert_within_bounds(rows(("alpha", "rgb"), found, reference, logits, torch.from_numpy(colour), coverage))
    found = liveview.agreement_logits(colour, coverage)
    assert_within_bounds([row("agreement", found, agreement_logits, colour, coverage)])
    seen, crop = (coverage > 0).any(1), (..., slice(target.height), slice(target.width))
    stage, arguments = composite, (alpha, rgb, seen[-1], maps)
    if "alpha_scale" in data:
        stage, arguments = composite_competing, (logits[:, 0], rgb, seen, maps, float(data["alpha_scale"]))
    found = getattr(liveview, stage.__name__)(*arguments)
    for name, part in (("frame", found.rgb), ("disparity", found.disparity), ("transmittance", found.transmittance)):
        assert np.array_equal(part[crop], data[name])
    weights = lambda *parts: stage(*parts).weights  # noqa: E731
    assert_within_bounds([row("frame", found.weights, weights, *arguments)])
    best = data["best_layer"]
    expected = np.bincount(best[best >= 0], minlength=len(maps))
    opacity = alpha if stage is composite else torch.from_numpy(found.weights)
    histogram = torch.from_numpy(liveview.plane_histogram(opacity[crop]))
    assert histogram.tolist() == expected.tolist() and plane_histogram(opacity[crop]).tolist() == expected.tolist()
    for count in (1, 2, 4, 20):
        assert liveview.select_planes(histogram, count) == select_planes(histogram, count)
        assert liveview.cover_planes(histogram, count) == cover_planes(histogram, count)


@pytest.mark.parametrize("name", SURFACE_CASES)
def test_every_stage_of_surface_layers(liveview, name):
    rendered = cases.surface_case(name)
    names = assert_within_bounds(cases.surface_rows(rendered))
    assert name != "wide" or {"half_ranges", "coarse_ranges"} <= names  # searched around a coarser map
    for count in (1, 2, 4, 5):
        map_ = rendered.data["surface"]
        found = liveview.Surface(map_, 0.1, 0.0).layers(count)
        expected = Surface(torch.from_numpy(map_), 0.1, 0.0).layers(count)
        np.testing.assert_allclose(found, expected, rtol=2e-7)


def test_search_of_4096_planes(liveview):
    assert_within_bounds(cases.many_planes())


@pytest.mark.parametrize("kind", ["plain", "rectified", "unseen", "coincident"])
def test_warp_of_a_smaller_photo(liveview, kind):
    images, cameras, target = rig_of(kind)
    maps = plane_maps(target, uniform_disparities(NEAR, FAR, 5), torch.float32)[:, ::2, ::2]
    small = torch.nn.functional.avg_pool2d(images[0][None], 2, ceil_mode=True, count_include_pad=False)[0].float()
    arguments = small, cameras[0], target, maps, 2.0
    assert_within_bounds(rows(("colour", "coverage"), liveview.warp_maps(*arguments), warp_maps, *arguments))


def test_views_planes_and_metrics(liveview, case):
    images, cameras, target = case[0]
    facing = len([camera for camera in cameras if float(camera.forward @ target.forward) > 0.5])
    for count in range(1, facing + 1):
        for kept in ((), (len(cameras) - 1,), tuple(range(0, len(cameras), 2))):
            assert liveview.choose_views(cameras, target, count, kept) == choose_views(cameras, target, count, kept)
    expected = uniform_disparities(NEAR, np.inf, 9)
    np.testing.assert_allclose(liveview.uniform_disparities(NEAR, np.inf, 9), expected, rtol=1e-15)
    first, second = images[:2]
    assert liveview.psnr(first, second) == pytest.approx(psnr(first.double(), second.double()), abs=1e-6)
    assert liveview.ssim(first, second) == pytest.approx(ssim(first.double(), second.double()), abs=1e-6)
    found = liveview.sharpened(first, 0.1)
    assert_within_bounds([row("sharpened", found, sharpened, first, 0.1, entry="surface {}")])


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
                # Slots such as __getitem__ have Python's own documentation.
                if isinstance(method, ast.FunctionDef) and not method.name.startswith("__"):
                    same(method, getattr(found, method.name))
    named = {node.name for node in stubs.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    assert set(liveview._liveview.__all__) - {"_stages"} <= named and documented > 60
