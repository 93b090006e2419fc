"""Surface layers: against figures computed by hand, and on a synthetic scene of known depth."""

import subprocess

import numpy as np
import pytest
import torch
from PIL import Image
from toy_rigs import SQUARE, WALL, surface_rig

from liveview_ref.data.scene import write_scene
from liveview_ref.paths import BINARY
from liveview_ref.reference.liveview import Camera
from liveview_ref.reference.surface import anchored_depth as anchored_module
from liveview_ref.reference.surface import target_surface as surface_module
from liveview_ref.reference.surface.aggregate import aggregate, jump_penalties
from liveview_ref.reference.surface.anchored_depth import detail_pixels
from liveview_ref.reference.surface.correction import balanced, exposure_gains
from liveview_ref.reference.surface.fusion import (
    ConfirmedDisparity,
    SurfaceView,
    confirmed,
    nearer_edges,
    splat,
    visible,
)
from liveview_ref.reference.surface.photo_depth import PhotoDisparity, bands, photo_depth
from liveview_ref.reference.surface.photo_sweep import NONE, UNSEEN_COST, Candidates, Grid, costs
from liveview_ref.reference.surface.render import hide, render
from liveview_ref.reference.surface.target_surface import Surface, fill_holes, surface
from liveview_ref.rig_arrays import cameras_of, images_of

NEAR, FAR = 2.0, 9.0


def camera(x: float = 0.0, width: int = 12, height: int = 6, focal: float = 10.0) -> Camera:
    k = torch.tensor([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]], dtype=torch.float64)
    return Camera(k, torch.eye(3, dtype=torch.float64), torch.tensor([-x, 0, 0], dtype=torch.float64), width, height)


def filled(value: float, height: int = 6, width: int = 12) -> torch.Tensor:
    return torch.full((height, width), value, dtype=torch.float64)


def read_photo(path) -> torch.Tensor:
    with Image.open(path) as image:
        return torch.from_numpy(np.array(image.convert("RGB"))).permute(2, 0, 1).double() / 255


def test_grid_runs_from_near_to_far_without_negative_disparities():
    grid = Grid.of(2.0, float("inf"), 5)
    assert grid.disparity(torch.tensor([0.0, 1.5, 4.0, 9.0])).tolist() == [0.5, 0.3125, 0.0, 0.0]
    assert grid.divided(2) == Grid(0.5, 0.0625, 9)


def test_bands_have_one_segment_two_adjacent_or_two_separate():
    index = torch.tensor([[10.0, 10.5, 10.5, 14.0, 14.0, 14.0, 40.0, 40.0]], dtype=torch.float64)
    assert bands(index, 2, 101)[0].tolist() == [
        [18, NONE],  # 20 to 21: round(20.5) is 21
        [18, NONE],
        [18, 26],  # 21 to 28: round(24.5) is 25
        [18, 26],
        [25, NONE],
        [25, 76],  # 28 to 80
        [25, 76],
        [77, NONE],
    ]
    assert bands(torch.zeros(1, 1), 2, 101)[0, 0].tolist() == [0, NONE]
    assert bands(torch.full((1, 1), 50.0), 2, 101)[0, 0].tolist() == [93, NONE]


def test_costs_of_shifted_photo_are_0_at_its_disparity_and_maximal_where_unseen():
    image = torch.rand(3, 6, 12, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    grid = Grid.of(1.0, float("inf"), 11)  # 10 pixels apart: index k is 10 - k pixels
    candidates = Candidates.all(grid, 6, 12)
    shifted = torch.zeros_like(image)
    shifted[:, :, :-3] = image[:, :, 3:]
    found = costs(image, camera(), [(shifted, camera(1.0))], grid, candidates, 1)
    assert found.shape == (16, 6, 12)
    assert found[7, :, 3:].max() == 0 and found[7, :, :3].min() == round(UNSEEN_COST * 32768)
    assert (found[:11, :, 4:10] > 0).sum() == 10 * 36


def test_costs_average_the_two_best_neighbours():
    """Photos of one colour, 0.1, 0 and 0.05 brighter: only the difference of colour costs."""
    grey = torch.full((3, 6, 12), 0.5, dtype=torch.float64)
    grid = Grid.of(1.0, float("inf"), 2)
    candidates = Candidates.all(grid, 6, 12)

    def cost(*brighter: float) -> float:
        around = [(grey + more, camera()) for more in brighter]
        return float(costs(grey, camera(), around, grid, candidates, 1)[0, 2, 2]) / 32768

    assert cost(0.1) == pytest.approx(0.05, abs=1e-4) and cost(0.1, 0.0) == pytest.approx(0.025, abs=1e-4)
    assert cost(0.1, 0.0, 0.05) == pytest.approx(0.0125, abs=1e-4)


def test_jump_penalties_are_lower_at_edges():
    photo = torch.zeros(3, 1, 4, dtype=torch.float64)
    photo[:, 0, 2], photo[:, 0, 3] = 0.05, 10
    across, down = jump_penalties(photo)
    assert across.tolist() == [[3932, 1966, 331]] and down.shape == (0, 4)


def test_aggregation_takes_the_nearer_of_ties_and_refines_by_a_parabola():
    photo = torch.zeros(3, 2, 2, dtype=torch.float64)
    candidates = Candidates.all(Grid.of(1.0, 2.0, 12), 2, 2)
    flat = torch.full((16, 2, 2), 100)
    assert aggregate(flat, photo, candidates).tolist() == [[0, 0], [0, 0]]
    valley = 100 * (torch.arange(16) - 4).abs()[:, None, None].expand(16, 2, 2).clone()
    valley[5] = 50
    assert aggregate(valley, photo, candidates).tolist() == [[4 + 0.5 * 50 / 150] * 2] * 2
    flat[13] = 0  # beyond the grid's end
    assert aggregate(flat, photo, candidates).max() == 0


def test_aggregation_reaches_an_index_missing_in_the_previous_cell_only_by_a_jump():
    """By hand along one row: 16 candidates and 8, one of them in both."""
    starts = torch.tensor([[[0, 8], [15, NONE]]])
    candidates = Candidates.two(starts, 1, 3)
    volume = torch.full((16, 1, 3), 1000)
    volume[15, 0, :2], volume[0, 0, 2] = 0, 0
    photo = torch.zeros(3, 1, 3, dtype=torch.float64)
    assert aggregate(volume, photo, candidates).tolist() == [[15, 15, 15]]


def test_depth_is_confirmed_by_agreeing_maps_unless_more_see_past_it():
    near, far = PhotoDisparity(filled(0.5), 0.01), PhotoDisparity(filled(0.2), 0.01)
    cameras = [camera(x) for x in (0.0, 0.1, 0.2, 0.3)]

    def share(*maps: PhotoDisparity) -> float:
        return float(confirmed(0, list(zip(cameras, maps, strict=False)))[:, 2:].double().mean())

    assert share(near, near) == 1 and share(near, far) == 0
    assert share(near, near, far) == 1 and share(near, near, far, far) == 0
    assert share(far, near) == 0, "an occluding map does not confirm"
    assert share(near) == 0, "a single map"


def test_splat_averages_the_nearest_depth_with_those_close_behind():
    maps = [(camera(), filled(0.5)), (camera(), filled(0.49)), (camera(), filled(0.3)), (camera(), filled(-1.0))]
    assert splat(maps, camera(), 8, 16, 0.0, 0.0)[:6, :12].unique().tolist() == [0.5]
    found = splat(maps, camera(), 8, 16, 0.05, 0.05)
    torch.testing.assert_close(found[:6, :12], filled(0.495))
    assert found[6:].max() == -1 and found[:, 12:].max() == -1


def test_splat_prefers_two_agreeing_photos_over_a_single_nearer_one():
    maps = [(camera(), filled(disparity)) for disparity in (0.5, 0.3, 0.29, 0.27)]
    found = splat(maps, camera(), 8, 16, 0.015, 0.025)[:6, :12]
    torch.testing.assert_close(found, filled(0.295))
    assert splat(maps[:2], camera(), 8, 16, 0.015, 0.025)[:6, :12].unique().tolist() == [0.5]
    assert splat(maps[:2], camera(), 8, 16, 0.015, 0.025, single=False).unique().tolist() == [-1]


def test_splat_of_a_point_near_a_pixel_edge_covers_both_pixels():
    one = filled(-1.0)
    one[2, 5] = 0.4
    shifted = camera(-0.1)  # 0.4 pixels to the right
    found = splat([(camera(), one)], shifted, 8, 16, 0.05, 0.05)
    assert (found >= 0).nonzero().tolist() == [[2, 5], [2, 6]]
    one[2, 5] = 0.25  # 0.25 pixels: inside by 0.05
    found = splat([(camera(), one)], shifted, 8, 16, 0.05, 0.05)
    assert (found >= 0).nonzero().tolist() == [[2, 5]]


def test_depth_beside_an_edge_becomes_that_of_two_other_photos():
    """All from one viewpoint, where every depth has the same colours."""
    photos = [(torch.full((3, 6, 12), 0.5, dtype=torch.float64), camera())] * 3
    own, other, sure = filled(0.2), filled(0.2), torch.ones(6, 12, dtype=torch.bool)
    own[:, 6:], other[:, 5:] = 0.4, 0.4
    maps = [PhotoDisparity(map_, 0.01) for map_ in (own, other, other)]
    torch.testing.assert_close(nearer_edges(0, photos, maps, sure), other)
    assert torch.equal(nearer_edges(0, photos, maps, ~sure), own), "none is confirmed"
    assert torch.equal(nearer_edges(0, photos[:2], maps[:2], sure), own), "a single photo"
    assert torch.equal(nearer_edges(1, photos, maps, sure), other), "it is nearer already"
    flat = [PhotoDisparity(filled(0.2), 0.01), *maps[1:]]
    assert torch.equal(nearer_edges(0, photos, flat, sure), filled(0.2)), "no edge"


def test_fill_holes_takes_the_farthest_neighbour():
    assert fill_holes(torch.tensor([[2.0, -1, -1, -1, -1, 1]])).tolist() == [[2, 2, 2, 1, 1, 1]]
    assert fill_holes(torch.full((2, 2), -1.0)).tolist() == [[0, 0], [0, 0]]


def test_visible_is_0_only_behind_a_confirmed_nearer_depth():
    own = filled(0.5)
    own[:, :6] = -1
    seen = visible(camera(), own, camera(), filled(0.4), 0.03)
    assert seen[:, :6].min() == 1 and seen[:, 6:].max() == 0
    assert visible(camera(), own, camera(), filled(0.48), 0.03).min() == 1


def test_hide_keeps_all_views_where_none_sees():
    """The first view is occluded on the right, the other on the last row."""
    hidden, bottom = filled(-1.0), filled(-1.0)
    hidden[:, 6:], bottom[5] = 0.5, 0.5
    colour = torch.stack([torch.full((3, 6, 12), value, dtype=torch.float64) for value in (0.2, 0.7)])
    masks = torch.stack([visible(camera(), own, camera(), filled(0.1), 0.03) for own in (hidden, bottom)])
    found, covered, seen = hide(masks, colour, filled(1.0).expand(2, 6, 12))
    assert covered[0, :5, 6:].max() == 0 and covered[1, :5].min() == 1 and covered[:, 5, 6:].min() == 1
    assert found[0, :, :5, 6:].max() == 0 and found[0, :, :, :6].unique().tolist() == [0.2]
    assert seen[:5].all() and seen[5, :6].all() and not seen[5, 6:].any()


def test_surface_layers_bracket_the_surface():
    step = filled(0.2)
    step[:, 6:] = 0.4
    layers = Surface(step, 0.01, 0.0).layers(3)
    assert layers[:, 0, 5].tolist() == [0.4, 0.2, 0.2], "the surface itself in the middle"
    evenly = torch.tensor([0.4, 1 / 3, 0.8 / 3, 0.2], dtype=torch.float64)
    torch.testing.assert_close(Surface(step, 0.01, 0.0).layers(4)[:, 0, 5], evenly)
    assert layers[:, 0, 4].tolist() == [0.2] * 3 and layers[:, 0, 7].tolist() == [0.4] * 3
    assert torch.equal(Surface(step, 0.01, 0.0).layers(1)[0], step)


@pytest.fixture(scope="module")
def scene():
    """Photos of the synthetic scene with their depth, in float32."""
    data = surface_rig(np.random.default_rng(5), 3, "exposure")
    torch.set_num_threads(1)  # many small steps
    cameras, target = cameras_of(data)
    views = list(zip(images_of(data, torch.float32), cameras, strict=True))
    maps = [photo_depth(v, views[:i] + views[i + 1 :], NEAR, FAR) for i, v in enumerate(views)]
    pairs = list(zip(cameras, maps, strict=True))
    sure = [ConfirmedDisparity.of(m, confirmed(i, pairs)) for i, m in enumerate(maps)]
    return [SurfaceView(*v, k, torch.ones(3)) for v, k in zip(views, sure, strict=True)], maps, target


def test_surface_of_synthetic_scene_has_its_depth(scene):
    views, maps, target = scene
    middle = maps[0].disparity[45:60, 87:102]
    assert abs(float(middle.median()) - 1 / SQUARE) < 0.02
    assert abs(float(maps[0].disparity[:30].median()) - 1 / WALL) < 0.03
    assert float((views[0].confirmed.disparity >= 0).double().mean()) > 0.7
    found = surface(views, target, NEAR, FAR)
    assert found.disparity.shape == (72, 120) and 0 < found.holes < 0.4
    assert abs(float(found.disparity[30:36, 55:65].median()) - 1 / SQUARE) < 0.02


def test_holes_are_searched_only_above_the_share(scene, monkeypatch):
    views, _, target = scene
    kept = torch.zeros(105, 189, dtype=torch.bool)
    kept[:, ::4] = True
    blind = [v._replace(confirmed=ConfirmedDisparity(torch.where(kept, v.confirmed.disparity, -1), 1.0)) for v in views]
    default = surface(blind, target, NEAR, FAR)
    assert default.holes > surface_module.SEARCHED_SHARE
    found = []
    for share in (0.0, 1.0):
        monkeypatch.setattr(surface_module, "SEARCHED_SHARE", share)
        found.append(surface(blind, target, NEAR, FAR).disparity)
    assert not torch.equal(*found)
    assert torch.equal(found[0], default.disparity)


def test_exposure_gains_undo_the_exposure(scene):
    gains = exposure_gains(scene[0], torch.tensor([0.0, 1, 2], dtype=torch.float64))
    expected = [(1 - 0.06 * i) ** -np.array([1, 2, 0.5]) for i in range(3)]
    np.testing.assert_allclose(gains, expected, atol=0.02)
    gains = balanced(torch.tensor([[1.0, 1.0], [4.0, 1.0]]), torch.tensor([2.0, 2.0]))
    torch.testing.assert_close(gains, torch.tensor([[0.5, 1.0], [2.0, 1.0]]))


def test_detail_of_an_enlarged_photo_is_as_large_as_it_was_enlarged():
    sharp = torch.rand(3, 270, 360, dtype=torch.float64, generator=torch.Generator().manual_seed(0))

    def enlarged(factor: int) -> torch.Tensor:
        return torch.nn.functional.interpolate(sharp[None], scale_factor=factor, mode="bicubic")[0]

    assert [detail_pixels(enlarged(factor)) for factor in (1, 2, 4)] == [1, 2, 4]


def test_anchored_depth_of_a_soft_photo_is_that_of_the_smaller_photo_enlarged(monkeypatch):
    data = surface_rig(np.random.default_rng(5), 3, "exposure")
    views = list(zip(images_of(data, torch.float64), cameras_of(data)[0], strict=True))
    small = [(anchored_module.shrink(image, 2), camera.shrunk(2)) for image, camera in views]
    expected = anchored_module.depth_at_full_size(small[0], small[1:], NEAR, FAR)
    monkeypatch.setattr(anchored_module, "detail_pixels", lambda _: 2)
    found = anchored_module.anchored_depth(views[0], views[1:], NEAR, FAR)
    height, width = found.disparity.shape
    rows, columns = torch.arange(height) // 2, torch.arange(width) // 2
    assert found.pixel == expected.pixel and torch.equal(found.disparity, expected.disparity[rows][:, columns])


@pytest.mark.skipif(not BINARY.exists(), reason="needs `make build`")
def test_default_picture_is_that_of_the_program(tmp_path, monkeypatch):
    """From two photos, with another one for the depth; where no pixel's colour is doubted."""
    data = surface_rig(np.random.default_rng(5), 4, "scene")
    cameras, names = cameras_of(data)[0], [f"{i:03}.png" for i in range(4)]
    write_scene(tmp_path, images_of(data, torch.float64), cameras, (NEAR, FAR))
    command = [BINARY, "render", tmp_path, "--target", names[0], "--views", "2", "-o", tmp_path / "out"]
    subprocess.run(command, check=True, capture_output=True)
    (picture,) = (tmp_path / "out").glob("*.png")
    expected, *photos = (read_photo(path) for path in (picture, *(tmp_path / name for name in names[1:])))
    surfaces = []
    keep = lambda *given: surfaces.append(surface(*given)) or surfaces[-1]  # noqa: E731
    monkeypatch.setitem(render.__globals__, "surface", keep)
    found, stages = render(list(zip(photos, cameras[1:], strict=True)), cameras[0], NEAR, FAR, 2)
    covered = (stages.coverage > 0).flatten(0, 1).any(0)[: cameras[0].height, : cameras[0].width]
    trusted = covered & (surfaces[0].confidence[: cameras[0].height, : cameras[0].width] == 1)
    assert covered.double().mean() > 0.9 and 0.8 < trusted.double().mean() < covered.double().mean()
    assert (found.rgb - expected).abs()[:, trusted].max() < 0.51 / 255  # the picture has 8 bits
