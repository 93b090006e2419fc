"""Hostile arguments: each is an exception that names the argument, and no panic crosses."""

from types import SimpleNamespace

import numpy as np
import pytest
from hostile_cases import NAN, Broken, Cases, H, W, f32, vars_of, with_value


@pytest.fixture(scope="module")
def cases(liveview) -> Cases:
    return Cases(liveview)


# Call, the argument that the message names, the exception, and what replaces good arguments.
TABLE = [
    ("camera", "k", ValueError, lambda c: {"k": np.eye(4)}),
    ("camera", "k", ValueError, lambda c: {"k": c.k_with(0, 0, NAN)}),
    ("camera", "k", ValueError, lambda c: {"k": c.k_with(1, 1, 0.0)}),
    ("camera", "k", ValueError, lambda c: {"k": c.k_with(1, 1, -30.0)}),
    ("camera", "k", ValueError, lambda c: {"k": c.k.T}),
    ("camera", "k", TypeError, lambda c: {"k": "K"}),
    ("camera", "k", TypeError, lambda c: {"k": None}),
    ("camera", "k", TypeError, lambda c: {"k": c.k.astype(complex)}),
    ("camera", "k", TypeError, lambda c: {"k": [[1, 2], [3]]}),
    ("camera", "pose", ValueError, lambda c: {"pose": np.eye(4)[:3]}),
    ("camera", "pose", ValueError, lambda c: {"pose": c.pose(0, 3, NAN)[2]}),
    ("camera", "pose", ValueError, lambda c: {"pose": 2 * np.eye(4)}),
    ("camera", "pose", ValueError, lambda c: {"pose": np.diag([1.0, 1, -1, 1])}),
    ("camera", "pose", ValueError, lambda c: {"pose": np.zeros((4, 4))}),
    ("camera", "pose", ValueError, lambda c: {"pose": c.pose(0, 3, 1e200)[2]}),
    ("camera", "width", ValueError, lambda c: {"width": 0}),
    ("camera", "width", ValueError, lambda c: {"width": 10**6}),
    ("camera", "width", TypeError, lambda c: {"width": -3}),
    ("camera", "height", TypeError, lambda c: {"height": 2.5}),
    ("camera", "convention", ValueError, lambda c: {"convention": "blender"}),
    ("scene", "photos", TypeError, lambda c: {"photos": c.photos.astype(np.float64)}),
    ("scene", "photos", TypeError, lambda c: {"photos": c.photos.astype(np.uint16)}),
    ("scene", "photos", TypeError, lambda c: {"photos": c.photos.astype(bool)}),
    ("scene", "photos", TypeError, lambda c: {"photos": (c.photos / np.float32(255)).astype(">f4")}),
    ("scene", "photos", TypeError, lambda c: {"photos": np.ma.masked_array(c.photos, c.photos > 9)}),
    ("scene", "photos", TypeError, lambda c: {"photos": 7}),
    ("scene", "photos", TypeError, lambda c: {"photos": [Broken()] * 5}),
    ("scene", "photos", TypeError, lambda c: {"photos": np.array([object()] * 5)}),
    ("scene", "photos", ValueError, lambda c: {"photos": c.photos[..., :1]}),
    ("scene", "photos", ValueError, lambda c: {"photos": c.photos.transpose(0, 3, 1, 2)}),
    ("scene", "photos", ValueError, lambda c: {"photos": np.concatenate([c.photos] * 2, -1)[..., :4]}),
    ("scene", "photos", ValueError, lambda c: {"photos": c.photos[0]}),
    ("scene", "photos", ValueError, lambda c: {"photos": c.photos[:0]}),
    ("scene", "photos", ValueError, lambda c: {"photos": c.photos[:, :0]}),
    ("scene", "photos", ValueError, lambda c: {"photos": []}),
    ("scene", "photos", ValueError, lambda c: {"photos": np.broadcast_to(np.uint8(1), (5, 1, 20000, 3))}),
    ("scene", "photos", ValueError, lambda c: {"photos": with_value(f32(5, H, W, 3), NAN)}),
    ("scene", "photos", ValueError, lambda c: {"photos": with_value(f32(5, H, W, 3), 1.5)}),
    ("scene", "photos", ValueError, lambda c: {"photos": with_value(f32(5, H, W, 3), -np.inf)}),
    ("scene", "poses", ValueError, lambda c: {"poses": c.poses[:4]}),
    ("scene", "poses", ValueError, lambda c: {"poses": c.poses[:, :3]}),
    ("scene", "poses", ValueError, lambda c: {"poses": c.pose(1, 1, NAN)}),
    ("scene", "poses", ValueError, lambda c: {"poses": c.pose(1, 1, np.inf)}),
    ("scene", "poses", ValueError, lambda c: {"poses": c.pose(3, 0, 1.0)}),
    ("scene", "poses", TypeError, lambda c: {"poses": c.poses.astype(str)}),
    ("scene", "poses", TypeError, lambda c: {"poses": 0.5}),
    ("scene", "k", ValueError, lambda c: {"k": np.stack([c.k] * 3)}),
    ("scene", "k", ValueError, lambda c: {"k": np.stack([c.k_with(0, 0, NAN)] * 5)}),
    ("scene", "k", TypeError, lambda c: {"k": np.datetime64("2020")}),
    ("scene", "names", ValueError, lambda c: {"names": ["a", "b"]}),
    ("scene", "photos", ValueError, lambda c: {"names": ["a"] * 5}),
    ("scene", "names", TypeError, lambda c: {"names": [1, 2, 3, 4, 5]}),
    ("synthesizer", "scene", TypeError, lambda c: {"scene": "folder"}),
    ("synthesizer", "layers", ValueError, lambda c: {"layers": "surface:0"}),
    ("synthesizer", "layers", ValueError, lambda c: {"layers": "clouds:3"}),
    ("synthesizer", "views", ValueError, lambda c: {"views": 0}),
    ("synthesizer", "views", TypeError, lambda c: {"views": -1}),
    ("synthesizer", "near", TypeError, lambda c: {"near": "close"}),
    ("synthesizer", "progress", TypeError, lambda c: {"progress": 5}),
    ("live", "cameras", ValueError, lambda c: {"cameras": []}),
    ("live", "cameras", TypeError, lambda c: {"cameras": [c.k]}),
    ("live", "near", ValueError, lambda c: {"near": NAN}),
    ("live", "near", ValueError, lambda c: {"far": 0.5}),
    ("live", "layers", ValueError, lambda c: {"layers": "clouds:3"}),
    ("live", "policy", ValueError, lambda c: {"policy": "sometimes"}),
    ("live", "policy", ValueError, lambda c: {"policy": "propagate", "layers": "planes:4"}),
    ("live", "views", ValueError, lambda c: {"views": 0}),
    ("warp_maps", "image", TypeError, lambda c: {"image": np.zeros((3, H, W))}),
    ("warp_maps", "image", ValueError, lambda c: {"image": f32(H, W, 3)}),
    ("warp_maps", "image", ValueError, lambda c: {"image": f32(3, H, 0)}),
    ("warp_maps", "maps", ValueError, lambda c: {"maps": f32(H, W)}),
    ("warp_maps", "maps", ValueError, lambda c: {"maps": f32(0, H, W)}),
    ("warp_maps", "maps", TypeError, lambda c: {"maps": np.ones((1, H, W), np.float16)}),
    ("warp_maps", "source", TypeError, lambda c: {"source": c.k}),
    ("warp_maps", "target", ValueError, lambda c: {"target": SimpleNamespace(**vars_of(c.camera, k=c.k * NAN))}),
    (
        "warp_maps",
        "target",
        ValueError,
        lambda c: {"target": SimpleNamespace(**vars_of(c.camera, k=c.k_with(1, 0, 3)))},
    ),
    ("warp_maps", "target", ValueError, lambda c: {"target": SimpleNamespace(**vars_of(c.camera, k=2 * c.k))}),
    ("warp_maps", "scale", ValueError, lambda c: {"scale": 0.0}),
    ("warp_maps", "scale", ValueError, lambda c: {"scale": NAN}),
    ("blend", "colour", ValueError, lambda c: {"colour": f32(2, 3, 3, H, W)}),
    ("blend", "coverage", ValueError, lambda c: {"coverage": f32(2, 4, H, W + 1)}),
    ("blend", "logits", TypeError, lambda c: {"logits": np.zeros((2, 4, H, W), int)}),
    ("blend", "distances", ValueError, lambda c: {"distances": np.ones(3)}),
    ("blend", "distances", ValueError, lambda c: {"distances": np.ones((3, 4))}),
    ("blend", "distances", ValueError, lambda c: {"distances": [1, 1, -1, 1]}),
    ("blend", "distances", ValueError, lambda c: {"distances": [1, 1, NAN, 1]}),
    ("blend", "power", ValueError, lambda c: {"power": np.inf}),
    ("composite", "rgb", ValueError, lambda c: {"rgb": f32(3, 3, H, W)}),
    ("composite", "covered", TypeError, lambda c: {"covered": f32(H, W)}),
    ("composite", "covered", ValueError, lambda c: {"covered": np.ones((2, H, W), bool)}),
    ("composite", "maps", ValueError, lambda c: {"maps": f32(2, W, H)}),
    ("composite_competing", "covered", ValueError, lambda c: {"covered": np.ones((H, W), bool)}),
    ("composite_competing", "scale", ValueError, lambda c: {"scale": -1.0}),
    ("agreement_logits", "colour", ValueError, lambda c: {"colour": f32(2, 12, H, W)}),
    ("agreement_logits", "coverage", ValueError, lambda c: {"coverage": f32(2, 3, H, W)}),
    ("sharpened", "amount", ValueError, lambda c: {"amount": NAN}),
    ("uniform_disparities", "near", ValueError, lambda c: {"near": 0}),
    ("uniform_disparities", "near", ValueError, lambda c: {"near": 9, "far": 1}),
    ("uniform_disparities", "count", ValueError, lambda c: {"count": 0}),
    ("uniform_disparities", "count", ValueError, lambda c: {"count": 2**40}),
    ("uniform_disparities", "count", TypeError, lambda c: {"count": -1}),
    ("plane_histogram", "alpha", ValueError, lambda c: {"alpha": f32(H, W)}),
    ("select_planes", "histogram", ValueError, lambda c: {"histogram": [1, -2]}),
    ("select_planes", "histogram", ValueError, lambda c: {"histogram": [1.5, 2]}),
    ("select_planes", "count", TypeError, lambda c: {"count": 1.5}),
    ("cover_planes", "histogram", ValueError, lambda c: {"histogram": np.ones(5000)}),
    ("cover_planes", "histogram", ValueError, lambda c: {"histogram": [1e30, 3, 4]}),
    ("guided_search", "cameras", ValueError, lambda c: {"cameras": [c.camera]}),
    ("guided_search", "views", ValueError, lambda c: {"views": []}),
    ("guided_search", "views", ValueError, lambda c: {"views": [f32(3, H, W + 1)] * 2}),
    ("guided_search", "near", ValueError, lambda c: {"near": NAN}),
    ("guided_search", "planes", ValueError, lambda c: {"planes": 1}),
    ("guided_layers", "count", ValueError, lambda c: {"count": 0}),
    ("choose_views", "cameras", ValueError, lambda c: {"count": 3}),
    ("choose_views", "cameras", ValueError, lambda c: {"cameras": []}),
    ("view_distances", "cameras", TypeError, lambda c: {"cameras": [3]}),
    ("psnr", "truth", ValueError, lambda c: {"truth": f32(3, W, H)}),
    ("ssim", "image", ValueError, lambda c: {"image": f32(3, 5, 5), "truth": f32(3, 5, 5)}),
    ("photo_depth", "photo", ValueError, lambda c: {"photo": (with_value(f32(3, H, W), NAN), c.camera)}),
    ("photo_depth", "photo", TypeError, lambda c: {"photo": f32(3, H, W)}),
    ("photo_depth", "neighbours", ValueError, lambda c: {"neighbours": []}),
    ("photo_depth", "neighbours", ValueError, lambda c: {"neighbours": [(f32(3, W, H), c.camera)]}),
    ("photo_depth", "near", ValueError, lambda c: {"near": -1}),
    ("anchored_depth", "neighbours", TypeError, lambda c: {"neighbours": 3}),
    ("confirmed", "which", ValueError, lambda c: {"which": 2}),
    ("confirmed", "which", TypeError, lambda c: {"which": -1}),
    ("confirmed", "maps", ValueError, lambda c: {"maps": []}),
    ("confirmed", "maps", ValueError, lambda c: {"maps": [(c.camera, c.lv.PhotoDisparity(f32(W, H), 0.1))]}),
    ("confirmed", "maps", ValueError, lambda c: {"maps": [(c.camera, c.lv.PhotoDisparity(f32(H, W), NAN))]}),
    ("visible", "confirmed", ValueError, lambda c: {"confirmed": f32(W, H)}),
    ("visible", "disparity", ValueError, lambda c: {"disparity": with_value(f32(H, W), NAN)}),
    ("visible", "disparity", ValueError, lambda c: {"disparity": f32(H, W + 3)}),
    ("visible_or_past", "margin", ValueError, lambda c: {"margin": -1.0}),
    ("surface", "views", ValueError, lambda c: {"views": []}),
    ("surface", "views", ValueError, lambda c: {"views": c.seen(gains=np.ones(4))}),
    ("surface", "views", ValueError, lambda c: {"views": c.seen(gains=[1, 0, 1])}),
    ("surface", "views", TypeError, lambda c: {"views": [(1, 2)]}),
    ("surface_layers", "count", ValueError, lambda c: {"count": 0}),
    ("surface_layers", "count", TypeError, lambda c: {"count": "three"}),
    ("surface_layers", "disparity", ValueError, lambda c: {"disparity": with_value(f32(H, W), NAN)}),
    ("exposure_gains", "distances", ValueError, lambda c: {"distances": [1.0, 2.0]}),
    ("sharpening", "views", ValueError, lambda c: {"views": c.seen(image=f32(3, H, W, value=2))}),
    ("fill_holes", "map_", ValueError, lambda c: {"map_": with_value(f32(H, W), np.inf)}),
    ("median3", "x", ValueError, lambda c: {"x": f32(H)}),
]


def test_good_arguments_are_accepted(cases):
    for name in cases.good:
        cases.call(name)
    cases.call("warp_maps", source=SimpleNamespace(**vars_of(cases.camera)))


@pytest.mark.parametrize(("name", "argument", "kind", "changed"), TABLE)
def test_hostile_argument_is_named(cases, name, argument, kind, changed):
    with pytest.raises(kind) as caught:
        cases.call(name, **changed(cases))
    message = "\n".join([str(caught.value), *getattr(caught.value, "__notes__", [])])
    assert argument in message and "internal error" not in message, message


def test_table_is_long_enough():
    assert len(TABLE) >= 60


def test_hostile_targets_and_paths_are_the_library_s_errors(liveview, cases, tmp_path):
    synthesizer = cases.call("synthesizer")
    away = np.diag([-1.0, 1, -1, 1])
    for target, kind, text in [
        ("nobody", liveview.Error, "nobody"),
        (9, ValueError, "target"),
        (-6, ValueError, "target"),
        (None, TypeError, "target"),
        (cases.k, TypeError, "target"),
        (cases.camera.with_pose(away), liveview.Error, "views are needed"),
    ]:
        with pytest.raises(kind, match=text):
            synthesizer.render(target)
    for path in (tmp_path / "missing", tmp_path):
        with pytest.raises(liveview.Error, match=str(path)):
            liveview.Scene(path)
    with pytest.raises(liveview.Error, match="missing"):
        cases.call("synthesizer", network=tmp_path / "missing.onnx")
    with pytest.raises(ValueError, match="targets"):
        synthesizer.render_path([])
    with pytest.raises(liveview.Error, match="near"):
        cases.call("synthesizer", near=9, far=1).render(0)
    with pytest.raises(liveview.Error, match="missing"):
        synthesizer.render(0).save(tmp_path / "missing" / "a.png")


def test_a_changed_array_does_not_change_its_frame(cases):
    frame = cases.call("synthesizer").render(0)
    before = frame.picture
    for array in (frame.picture, frame.raw, frame.disparity):
        array.fill(0.5)
    assert np.array_equal(frame.picture, before)


def test_tiny_and_extreme_values_do_not_panic(liveview, cases):
    """Whatever comes out, it is an array or a named exception."""
    for size in ((1, 1), (1, 40), (40, 1), (7, 9)):
        camera = liveview.Camera(cases.k, np.eye(4), size[1], size[0])
        beside = camera.with_pose(cases.poses[1])
        image = f32(3, *size)
        depth = liveview.photo_depth((image, camera), [(image, beside)], 1, np.inf)
        assert depth.disparity.shape == size
        assert liveview.anchored_depth((image, camera), [(image, beside)], 1, 1.0000001).disparity.shape == size
        view = SimpleNamespace(image=image, camera=camera, confirmed=depth, gains=np.ones(3, np.float32))
        liveview.surface([view, view], camera, 1, 9)
        liveview.guided_layers([image] * 2, [camera, beside], camera, 1e-30, 1e30, 3)
    for value in (NAN, np.inf, -np.inf, 3e38, -3e38, 1e-45):
        maps = f32(2, H, W, value=value)
        liveview.warp_maps(f32(3, H, W, value=value), cases.camera, cases.camera, maps)
        liveview.composite(maps, f32(2, 3, H, W, value=value), np.ones((H, W), bool), maps)
        liveview.composite_competing(maps, f32(2, 3, H, W), np.ones((2, H, W), bool), maps)
        liveview.blend(f32(2, 4, H, W, value=value), f32(2, 4, 3, H, W), f32(2, 4, H, W), np.zeros(4))
        liveview.plane_histogram(maps)
