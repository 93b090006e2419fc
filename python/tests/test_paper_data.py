"""Readers of the paper's own data sets, on files of their formats that are written here."""

import json
import math

import numpy as np
import pytest
import torch
from PIL import Image

from liveview_ref.paper import data_deepfocus, data_spaces
from liveview_ref.paper.captured_samples import samples_of
from liveview_ref.paper.samples import CROP
from liveview_ref.reference.render.renderer import warp_views

SIZE = 96


def models(count: int = 16) -> list[dict]:
    """A rig position: rows of cameras, each turned a little, photos of half the declared size."""
    rows = [(0.0, range(4)), (0.1, range(5)), (0.2, range(4)), (0.3, range(3))]
    places = [(0.1 * (i - (len(row) - 1) / 2), y, 0.0) for y, row in rows for i in row]
    return [
        {
            "relative_path": f"cam_{i:02}/image_000.JPG", "principal_point": [31.0, 25.0], "pixel_aspect_ratio": 1.25,
            "position": list(place), "orientation": [0.0, 0.1 * (i % 3 - 1), 0.02], "width": 64.0, "height": 48.0,
            "focal_length": 40.0,
        }
        for i, place in enumerate(places[:count])
    ]  # fmt: skip


def write_spaces(folder, positions, photo_size=(32, 24)):
    folder.mkdir(parents=True)
    (folder / "models.json").write_text(json.dumps(positions))
    for i in range(16):
        (folder / f"cam_{i:02}").mkdir()
        Image.new("RGB", photo_size, (i, 2 * i, 255)).save(folder / f"cam_{i:02}/image_000.JPG", quality=100)


def test_spaces_views_cameras_and_targets(tmp_path):
    write_spaces(tmp_path / "scene_009", [models(), models()])
    scene = data_spaces.Spaces(tmp_path, "test", 4)[0]
    assert scene.name == "scene_009" and len(scene.images) == 4
    assert scene.places == [f"cam_{i:02}" for i in (1, 2, 4, 5, 6, 7, 8, 10, 11)]
    assert [int(image[0].float().mean().round()) for image in scene.images] == pytest.approx([0, 3, 9, 12], abs=2)
    camera, declared = scene.cameras[1], models()[3]
    # Photos of half the declared size: all of K is halved.
    assert camera.k.tolist() == [[20, 0, 15.5], [0, 25, 12.5], [0, 0, 1]] and (camera.width, camera.height) == (32, 24)
    assert camera.centre.tolist() == pytest.approx(declared["position"], abs=1e-12)
    axis_angle = np.array(declared["orientation"])
    angle = np.linalg.norm(axis_angle)
    # Turned about its axis by the angle: the axis stays, and the trace is that of the angle.
    assert (camera.rotation @ torch.from_numpy(axis_angle)).tolist() == pytest.approx(axis_angle.tolist())
    assert float(camera.rotation.trace()) == pytest.approx(1 + 2 * math.cos(angle))
    # cam_from_world: turning about +y takes a point ahead, which was at +z, to +x.
    one = data_spaces.rotation_of([0.0, 0.1, 0.0]) @ torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    assert one.tolist() == pytest.approx([math.sin(0.1), 0, math.cos(0.1)])


@pytest.mark.parametrize(("views", "targets"), [(4, 9), (5, 8), (10, 3)])
def test_spaces_configurations_keep_inputs_and_targets_apart(tmp_path, views, targets):
    write_spaces(tmp_path / "scene_000", [models()])
    scene = data_spaces.Spaces(tmp_path, "test", views)[0]
    assert len(scene.photos(views).images) == views and len(scene.places) == targets
    centres = {tuple(c.centre.tolist()) for c in scene.cameras}
    assert not centres & {tuple(scene.target(i)[0].centre.tolist()) for i in range(targets)}
    # The references stand in the middle of their quincunx.
    at = [scene.cameras[i].centre for i in scene.references]
    if views == 10:
        for k, start in ((0, 0), (1, 5)):
            assert torch.stack([c.centre for c in scene.cameras[start + 1 : start + 5]]).mean(0).allclose(at[k])
    with pytest.raises(ValueError, match="not 7"):
        scene.photos(7)


def test_spaces_splits(tmp_path):
    for n in (0, 1, 2, 9, 73):
        (tmp_path / f"scene_{n:03}").mkdir()
    names = {s: [p.name for p in data_spaces.scenes_of(tmp_path, s)] for s in ("train", "validation", "test")}
    assert names["test"] == ["scene_000", "scene_009", "scene_073"]
    assert sorted(names["train"] + names["validation"]) == ["scene_001", "scene_002"]
    with pytest.raises(ValueError, match="no scene of the test split"):
        data_spaces.scenes_of(tmp_path / "scene_000", "test")


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("focal_length", "40", r'models.json: \[0\]\[3\].focal_length: found "40"; expected a positive number'),
        ("orientation", [0, 1], r"\[0\]\[3\].orientation: found \[0, 1\]; expected 3 numbers"),
        ("principal_point", None, r"\[0\]\[3\].principal_point: found null; expected 2 numbers"),
        ("width", 0, r"\[0\]\[3\].width: found 0; expected a positive number"),
        ("relative_path", 7, r"\[0\]\[3\].relative_path: found 7; expected a path"),
    ],
)
def test_spaces_errors_name_file_and_field(tmp_path, field, value, message):
    rig = models()
    rig[3][field] = value
    write_spaces(tmp_path / "scene_000", [rig])
    with pytest.raises(ValueError, match=message):
        data_spaces.read_scene(tmp_path / "scene_000", 4)
    del rig[3][field]
    (tmp_path / "scene_000/models.json").write_text(json.dumps([rig]))
    with pytest.raises(ValueError, match=rf"\[0\]\[3\].{field}: missing"):
        data_spaces.read_scene(tmp_path / "scene_000", 4)


def test_spaces_errors_of_files(tmp_path):
    with pytest.raises(ValueError, match="models.json is missing"):
        data_spaces.read_scene(tmp_path, 4)
    (tmp_path / "models.json").write_text("[[")
    with pytest.raises(ValueError, match="expected JSON"):
        data_spaces.read_scene(tmp_path, 4)
    (tmp_path / "models.json").write_text(json.dumps([models(15)]))
    with pytest.raises(ValueError, match="expected a list of 16 cameras"):
        data_spaces.read_scene(tmp_path, 4)
    write_spaces(tmp_path / "scene_000", [models()])
    (tmp_path / "scene_000/cam_03/image_000.JPG").write_bytes(b"no photo")
    with pytest.raises(ValueError, match=r"cam_03/image_000.JPG: .* expected a photo"):
        data_spaces.read_scene(tmp_path / "scene_000", 4)
    with pytest.raises(ValueError, match="no configuration of 3 views; expected 4, 5, 10"):
        data_spaces.Spaces(tmp_path, "test", 3)


def test_training_samples_of_spaces(tmp_path):
    for number in (1, 2, 9):
        write_spaces(tmp_path / f"scene_{number:03}", [models()], (96, 72))
    samples = samples_of(tmp_path)
    first, again, other = samples(4, 3), samples(4, 3), samples(4, 4)
    assert first.truth.shape == (3, CROP, CROP) and (first.target.width, first.target.height) == (CROP, CROP)
    assert torch.equal(first.truth, again.truth) and torch.equal(first.target.k, again.target.k)
    assert not torch.equal(first.target.k, other.target.k)
    assert (first.near, first.far) == (1, 100) and len(first.photos.images) == 4
    assert bool(first.disparity_at(first.target).isnan().all())


# Of the made light field: a wall and a board before it, seen by parallel cameras whose images are shifted.
PARALLAX, SHIFT = (3.0, -2.5), (-0.3, 0.4)
WALL, BOARD = 6.0, 1.5


def texture(x: torch.Tensor, y: torch.Tensor, seed: int) -> torch.Tensor:
    """Smooth colours [3, H, W] in [0.1, 0.9] of points of a surface, without a period in sight."""
    rng = np.random.default_rng(seed)
    out = torch.zeros(3, *x.shape)
    for channel in range(3):
        for _ in range(6):
            fx, fy, phase = rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), rng.uniform(0, 6.3)
            out[channel] += torch.sin(fx * x + fy * y + phase) / 6
    return 0.5 + 0.4 * out


def light_field_view(column: int, row: int) -> tuple[torch.Tensor, torch.Tensor]:
    """sRGB-like colours [3, SIZE, SIZE] and depth [SIZE, SIZE]. Coordinates of a surface are the middle view's."""
    y, x = torch.meshgrid(torch.arange(SIZE) + 0.5, torch.arange(SIZE) + 0.5, indexing="ij")
    steps = column - 4, row - 4

    def at(depth: float):
        moved = [step * (p / depth - s) for step, p, s in zip(steps, PARALLAX, SHIFT, strict=True)]
        return x + moved[0], y + moved[1]

    wall, board = at(WALL), at(BOARD)
    front = ((board[0] - 50).abs() < 22) & ((board[1] - 45).abs() < 18)
    return torch.where(front, texture(*board, 1), texture(*wall, 2)), torch.where(front, BOARD, WALL)


def write_deepfocus(folder, seed: int) -> None:
    exr = pytest.importorskip("OpenEXR")
    scene = folder / f"seed{seed:04}" / "512"
    scene.mkdir(parents=True)
    head = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    for row in range(9):
        for column in range(9):
            image, depth = light_field_view(column, row)
            linear = image.pow(2.2).permute(1, 2, 0).contiguous().numpy()
            for kind, pixels in (("rgb", linear), ("depth", depth[..., None].repeat(1, 1, 3).float().numpy())):
                with exr.File(head, {"RGB": pixels}) as file:
                    file.write(str(scene / f"frame_{kind}{9 * row + column:04}.exr"))


@pytest.fixture(scope="module")
def deepfocus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    write_deepfocus(folder, 76)
    return folder


def test_deepfocus_finds_the_cameras(deepfocus):
    grid = data_deepfocus.find_grid(deepfocus / "seed0076/512")
    assert grid.parallax == pytest.approx(PARALLAX, abs=0.1)
    assert grid.shift == pytest.approx(SHIFT, abs=0.05)


@pytest.mark.parametrize("views", [4, 5, 10])
def test_deepfocus_photos_warped_by_the_depth_are_the_target(deepfocus, views):
    scene = data_deepfocus.DeepFocus(deepfocus, "test", views)[0]
    assert scene.name == "seed0076" and len(scene.places) == 6
    photos = scene.photos(views)
    target, truth, disparity = scene.target(1)
    assert truth.sub(light_field_view(4, 2)[0]).abs().max() < 0.003  # 8 bit
    colour, coverage = warp_views(photos.images, photos.cameras, target, disparity[None])
    error = (colour[0] - truth).abs().mean(1)[coverage[0] > 0.999]
    still = (torch.stack(photos.images) - truth).abs().mean(1)
    assert float(error.median()) < 0.01 and float(still.median()) > 5 * float(error.median())
    planes = scene.planes(3)
    assert float(planes[0]) >= 1 / BOARD and float(planes[-1]) <= 1 / WALL


def test_deepfocus_errors(deepfocus, tmp_path):
    with pytest.raises(ValueError, match="no scene of the train split; expected seed0000/512 to seed0065/512"):
        data_deepfocus.DeepFocus(deepfocus, "train", 4)
    folder = tmp_path / "seed0076" / "512"
    folder.mkdir(parents=True)
    with pytest.raises(ValueError, match="frame_rgb0040.exr is missing"):
        data_deepfocus.DeepFocus(tmp_path, "test", 4)[0]
    (folder / "frame_rgb0040.exr").write_bytes(b"no picture")
    with pytest.raises(ValueError, match="frame_rgb0040.exr: .*expected an OpenEXR picture"):
        data_deepfocus.find_grid.__wrapped__(folder)


def test_deepfocus_refuses_views_that_are_no_grid(deepfocus, tmp_path):
    """The depth of one scene with the pictures of another: no parallel cameras explain them."""
    pytest.importorskip("OpenEXR")
    source, folder = deepfocus / "seed0076" / "512", tmp_path / "512"
    folder.mkdir()
    for path in source.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    for number in (41, 42, 44):
        (folder / f"frame_rgb{number:04}.exr").write_bytes((source / "frame_rgb0080.exr").read_bytes())
    with pytest.raises(ValueError, match="cameras were not found"):
        data_deepfocus.find_grid.__wrapped__(folder)
