"""Depth of the photos and the target's surface, stage by stage: the library and the reference in
one process, on the same arrays. Elements that the last bits decide are doubtful (surface_cases.py):
they may be wrong, but only few are doubtful."""

import numpy as np
import pytest
import torch
from compared_cases import SurfaceCase, check, surface_case

from liveview_ref.parity import surface_cases, surface_stages
from liveview_ref.reference.liveview import view_distances
from liveview_ref.reference.surface.photo_depth import FINE_STEPS, PhotoDepth
from liveview_ref.reference.surface.photo_sweep import UNITS_PER_COST, UNSEEN_COST, is_searched, tile_ranges
from liveview_ref.reference.surface.target_surface import OCCLUSION_MARGIN, Surface

torch.set_num_threads(1)  # small arrays

CASES = list(surface_cases.CASES)
PHOTOS = CASES[:-1]  # the last has the first search only
COMPLETE = CASES[:-3]  # with stages at the target: not where the photos contradict each other


@pytest.fixture(scope="module")
def case(request) -> SurfaceCase:
    return surface_case(request.param)


def of_cases(names: list[str]):
    return pytest.mark.parametrize("case", names, indirect=True)


def grid(case: SurfaceCase) -> tuple:
    """The first search, as the package's stages take it."""
    return (*case.range, case.count, 1, 2, None, None)


@of_cases(CASES)
def test_search_at_half_resolution(liveview, inner, case):
    photo = case.views[0]
    case.check("half_costs", inner.costs(photo, case.neighbours(0), grid(case)))
    case.check("half_found", inner.aggregate(case["half_costs"], photo, grid(case)))
    case.check("half_index", liveview.median3(case["half_found"]))
    fine = surface_stages.fine_grid(case)
    case.check("starts", inner.bands(case["half_index"], FINE_STEPS, fine.count))
    index, coarse = torch.from_numpy(case["half_index"]), surface_stages.coarse_grid(case)
    found = inner.disparity(case["half_index"], grid(case)), coarse.disparity(index.double()), coarse.disparity(index)
    check("surface disparity", *(np.asarray(one) / coarse.nearest for one in found), scaled=False)


@of_cases(["wide"])
def test_search_around_a_coarser_map(inner, case):
    photo, planes = case.views[0], surface_stages.coarse_grid(case)
    size, coarser = case["half_index"].shape, case["coarse0"]
    exact = tile_ranges(torch.from_numpy(coarser).double(), planes, size)
    found = inner.tile_ranges(coarser, grid(case), size)
    np.testing.assert_array_equal(found, exact)
    searched = is_searched(exact, case["half_costs"].shape[2], size).permute(1, 2, 0).numpy()
    assert 0.2 < searched.mean() < 0.9
    volume = inner.costs(photo, case.neighbours(0), (*grid(case)[:-1], found))
    np.testing.assert_array_equal(volume[~searched], round(UNSEEN_COST * UNITS_PER_COST))
    everywhere = inner.costs(photo, case.neighbours(0), grid(case))
    np.testing.assert_array_equal(volume[searched], everywhere[searched])


@of_cases(PHOTOS)
def test_search_at_full_resolution(liveview, inner, case):
    fine = (*case.range, case.count, FINE_STEPS, 1, case["starts"], None)
    found = inner.costs(case.views[0], case.neighbours(0), fine)
    # The costs of a segment that a cell does not have are unspecified.
    there = surface_stages.fine_candidates(case).there.permute(1, 2, 0).numpy()
    case.check("fine_costs", np.where(there, found, 0))
    case.check("fine_found", inner.aggregate(case["fine_costs"], case.views[0], fine))
    case.check("fine_index", liveview.median3(case["fine_found"]))


@of_cases(PHOTOS)
def test_photo_depth(liveview, case):
    found = [liveview.photo_depth(view, case.neighbours(i), *case.range) for i, view in enumerate(case.views)]
    case.check_each("depth", [depth.disparity for depth in found])
    np.testing.assert_allclose([depth.pixel for depth in found], case["pixel"], rtol=3e-7)


@of_cases(PHOTOS)
def test_anchored_depth_and_its_stages(liveview, inner, case):
    views = [case.views[0], *case.neighbours(0)]
    others = [views[:i] + views[i + 1 :] for i in range(len(views))]
    found = [inner.small_map([view, *rest], *case.range) for view, rest in zip(views, others, strict=True)]
    case.check_each("coarse", [disparity for disparity, _ in found])
    np.testing.assert_allclose([pixel for _, pixel in found], case["coarse_pixel"], rtol=3e-7)
    cameras = [camera for _, camera in views]
    maps = [(map_, float(pixel)) for map_, pixel in zip(case.each("coarse"), case["coarse_pixel"], strict=True)]
    case.check_each("coarse_sure", [sure >= 0 for sure in inner.group_confirmed(cameras, maps)])
    sure = zip(maps, case.each("coarse_sure"), strict=True)
    confirmed = [np.where(yes > 0, map_, np.float32(-1)) for (map_, _), yes in sure]
    half = inner.disparity(case["half_index"], grid(case)), float(case["pixel"][0])
    kept, anchor = inner.anchors(cameras, maps, confirmed, half)
    case.check("kept", kept)
    case.check("anchor", anchor)
    found = inner.anchored_costs(case["half_costs"], case["kept"] > 0, case["anchor"], grid(case))
    case.check("anchored_costs", found)
    case.check("anchored", liveview.anchored_depth(views[0], views[1:], *case.range).disparity)


@of_cases(COMPLETE)
def test_confirmed_depths_and_their_range(liveview, inner, case):
    depths = [PhotoDepth(torch.from_numpy(d), float(p)) for d, p in zip(case.each("depth"), case["pixel"], strict=True)]
    maps = list(zip(case.cameras, depths, strict=True))
    case.check_each("confirmed", [liveview.confirmed(i, maps) for i in range(len(maps))])
    pairs = zip(case.each("depth"), case.each("confirmed"), strict=True)
    found = inner.depth_range(np.concatenate([depth[sure > 0] for depth, sure in pairs]), case.range)
    case.check("found_range", np.float32([1 / depth for depth in found] if found else [-1, -1]))


@of_cases(COMPLETE)
def test_nearer_edges(liveview, inner, case):
    maps = [(depth, float(pixel)) for depth, pixel in zip(case.each("depth"), case["pixel"], strict=True)]
    sure = [confirmed > 0 for confirmed in case.each("confirmed")]
    case.check_each("nearer", [inner.nearer_edges(i, case.views, maps, sure[i]) for i in range(len(maps))])
    nearer = zip(case.cameras, case.each("nearer"), case["pixel"], strict=True)
    maps = [(camera, PhotoDepth(torch.from_numpy(depth), float(pixel))) for camera, depth, pixel in nearer]
    case.check_each("sure", [liveview.confirmed(i, maps) for i in range(len(maps))])


@pytest.fixture(scope="module")
def views(case) -> list:
    return surface_stages.surface_views(case, torch.float32)


@of_cases(COMPLETE)
def test_correction_of_the_photos(liveview, case, views):
    case.check("gains", liveview.exposure_gains(views, view_distances(case.cameras, case.target)))
    case.check("sharpening", liveview.sharpening(views))
    amounts = case["sharpening"] + np.float32(surface_stages.ADDED_SHARPENING)
    photos = zip(case.views, amounts, strict=True)
    found = [np.moveaxis(liveview.sharpened(photo, float(amount)), 0, -1) for (photo, _), amount in photos]
    case.check_each("sharpened", found)


@pytest.fixture(scope="module")
def pixel(inner, case, views) -> float:
    """The disparity worth one pixel at the target."""
    found = inner.pixel_of(views, case.target, *case.range)
    assert found == pytest.approx(surface_stages.target_pixel(case), rel=3e-7)
    return found


@of_cases(COMPLETE)
def test_splat_and_its_holes(liveview, inner, case, views, pixel):
    case.check("splat", inner.splat(views, case.target, pixel))
    case.check("filled", liveview.fill_holes(case["splat"]))


@of_cases(COMPLETE)
def test_visibility(liveview, case, views, pixel):
    around = [(v.camera, v.confirmed.disparity, case.target, case["filled"], OCCLUSION_MARGIN * pixel) for v in views]
    or_past = np.stack([liveview.visible_or_past(*arguments) for arguments in around])
    case.check("visible", or_past)
    sees = np.stack([liveview.visible(*arguments) for arguments in around])
    assert (sees == (or_past != 0)).all()


@of_cases(COMPLETE)
def test_photo_variance(inner, case, views, pixel):
    maps = [np.maximum(case["filled"] + np.float32(o * pixel), np.float32(0)) for o in surface_stages.OFFSETS]
    found = [inner.photo_variance(views, case["visible"], case.target, map_) for map_ in maps]
    case.check("photo_variance", found)


@of_cases(COMPLETE)
def test_search_of_the_target(inner, case, views):
    searching = views[: surface_stages.SEARCHED_VIEWS], case.target, case["splat"], *case.range
    costs, found = inner.target_search(*searching)
    case.check("target_costs", costs)
    case.check("searched", found)


@of_cases(COMPLETE)
def test_samples_without_the_hidden(inner, case, views, pixel):
    colour, coverage, seen = inner.hide(views, case.target, case["filled"], OCCLUSION_MARGIN * pixel)
    case.check("hidden_colour", colour.reshape(case["oracle.hidden_colour"].shape))
    case.check("hidden_coverage", coverage)
    case.check("seen", seen)


@of_cases(COMPLETE)
def test_surface_and_layers(liveview, case, views):
    found = liveview.surface(views, case.target, *case.range)
    case.check("surface", found.disparity)
    case.check("layers", found.layers(surface_stages.LAYERS))
    for count in (1, 2, 4, 5):
        expected = Surface(torch.from_numpy(found.disparity), found.pixel, found.holes).layers(count)
        np.testing.assert_allclose(found.layers(count), expected, rtol=2e-7)
