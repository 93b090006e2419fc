"""The methods of the paper's comparison: shapes, gradients, weights, and scenes with known
views."""

import pytest
import torch

from liveview_ref.paper.data import rig
from liveview_ref.paper.methods import deepview, light_field_fusion, local_light_field, soft3d, stereo_magnification
from liveview_ref.paper.methods.method import Method, Photos, Predictor
from liveview_ref.paper.methods.mpi import Mpi, volume_at
from liveview_ref.reference.layers import warp_maps
from liveview_ref.reference.liveview import Camera

torch.set_num_threads(1)  # these tensors are small
SIZE, PLANES = 32, 8
NAMES = {
    "stereo_magnification": lambda: stereo_magnification.stereo_magnification(5, PLANES, width=4),
    "local_light_field": lambda: local_light_field.local_light_field(5),
    "target_centred": lambda: local_light_field.target_centred(5),
    "deepview": deepview.DeepView,
}


def texture(height: int, width: int) -> torch.Tensor:
    """A texture [3, H, W], smooth, without repetition, different in each colour."""
    generator = torch.Generator().manual_seed(0)
    noise = torch.rand(1, 3, height // 6 + 1, width // 6 + 1, generator=generator)
    return torch.nn.functional.interpolate(noise, (height, width), mode="bicubic", align_corners=True)[0].clamp(0, 1)


def plane_photos(views: int, disparity: float, crop: tuple[int, int, int, int] | None = None) -> tuple[Photos, object]:
    """Photos of a textured plane at that disparity, and its view in a camera of the rig."""
    middle = rig.camera(0, 0)
    wide = middle.with_window(-100, -100, middle.width + 200, middle.height + 200)
    painted = texture(wide.height, wide.width)

    def seen_from(camera):
        return warp_maps(painted, wide, camera, torch.full((1, camera.height, camera.width), disparity))[0][0]

    cameras = [rig.camera(*rig.CENTRES[i]) for i in rig.VIEWS[views]]
    if crop:
        cameras = [c.with_window(*crop) for c in cameras]
    return Photos([seen_from(c) for c in cameras], cameras, rig.REFERENCES[views]), seen_from


def small_target(x: float = 0.2, y: float = -0.3):
    return rig.camera(x, y).with_window(240, 160, SIZE, SIZE)


class KnownPlane(Predictor):
    """A predictor that knows the truth: one opaque plane, with the mean colour of the photos."""

    def __init__(self, plane: int):
        super().__init__()
        self.plane = plane

    def forward(self, volume, coverage, distances):
        alpha = torch.zeros_like(coverage[:, 0])
        alpha[self.plane] = 1
        return alpha, volume.sum(1) / coverage.sum(1).clamp_min(1e-6)[:, None]


@pytest.mark.parametrize("name", NAMES)
def test_method_trains_on_a_crop(name: str) -> None:
    torch.manual_seed(0)
    method: Method = NAMES[name]().train()
    photos, _ = plane_photos(5, 0.5)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        rendering = method(photos, small_target(), rig.planes(PLANES), cover=False)
    assert rendering.rgb.shape == (3, SIZE, SIZE) and rendering.rgb.dtype == torch.float32
    assert rendering.valid.shape == (SIZE, SIZE) and rendering.valid.any()
    assert rendering.rgb.isfinite().all() and rendering.rgb.min() >= 0 and rendering.rgb.max() <= 1
    rendering.rgb.square().mean().backward()
    without = [n for n, p in method.named_parameters() if p.grad is None or not p.grad.any()]
    assert without == []


@pytest.mark.parametrize("name", NAMES)
def test_untrained_method_covers_the_target(name: str) -> None:
    photos, _ = plane_photos(5, 0.5)
    with torch.no_grad():
        rendering = NAMES[name]().eval()(photos, small_target(-0.5, 0.5), rig.planes(PLANES))
    assert rendering.valid.all()


@pytest.mark.parametrize("target_centred", [True, False])
def test_known_plane_is_rendered(target_centred: bool) -> None:
    disparities = rig.planes(PLANES)
    photos, seen_from = plane_photos(5, float(disparities[3]))
    target = small_target()
    rendering = Mpi(KnownPlane(3), target_centred)(photos, target, disparities)
    assert (rendering.rgb - seen_from(target)).abs().mean() < 0.01


@pytest.mark.parametrize("predictor", [lambda: local_light_field.LocalLightField(5), lambda: KnownPlane(2)])
def test_target_at_the_reference_equals_its_image(predictor) -> None:
    torch.manual_seed(0)
    predictor = predictor().eval()
    photos, _ = plane_photos(5, 0.5)
    target = photos.cameras[0].with_window(240, 160, SIZE, SIZE)
    with torch.no_grad():
        centred = Mpi(predictor, True)(photos, target, rig.planes(PLANES), cover=False)
        carried = Mpi(predictor, False)(photos, target, rig.planes(PLANES), cover=False)
    assert torch.allclose(centred.rgb, carried.rgb, atol=1e-4)


@pytest.mark.parametrize("planes", [8, 11, 16])
def test_local_light_field_takes_any_number_of_planes(planes: int) -> None:
    photos, _ = plane_photos(5, 0.5)
    camera = small_target()
    with torch.no_grad():
        volume = volume_at(camera, photos, rig.planes(planes))
        alpha, rgb = local_light_field.LocalLightField(5)(*volume)
    assert alpha.shape == (planes, SIZE, SIZE) and rgb.shape == (planes, 3, SIZE, SIZE)


def test_local_light_field_weights_sum_to_one() -> None:
    """Photos of one colour give that colour for any weights, also where only some photos
    cover the point."""
    coverage = torch.ones(PLANES, 5, 16, 16)
    coverage[:, 1:, :8] = 0
    volume = torch.tensor([0.2, 0.5, 0.9])[:, None, None] * coverage[:, :, None]
    torch.manual_seed(0)
    with torch.no_grad():
        _, rgb = local_light_field.LocalLightField(5)(volume, coverage, torch.tensor([0.0, 1, 1, 1, 1]))
    assert torch.allclose(rgb, volume[:, 0], atol=1e-5)


def test_stereo_magnification_blends_reference_and_background() -> None:
    """With weights of 1 the colours are the reference's where it covers the pixel,
    else the background's."""
    torch.manual_seed(0)
    net = stereo_magnification.StereoMagnification(5, PLANES, width=4)
    with torch.no_grad():
        net.out.bias[:PLANES] = 50
        net.out.weight[-3:] = 0
        net.out.bias[-3:] = torch.atanh(torch.tensor([-0.5, 0.0, 0.5]))
        coverage = torch.ones(PLANES, 5, 16, 16)
        coverage[:, 2, :, :4] = 0
        volume = torch.rand(PLANES, 5, 3, 16, 16) * coverage[:, :, None]
        volume[:] = torch.where(torch.arange(5)[:, None, None, None] == 2, volume[0], volume)
        _, rgb = net(volume, coverage, torch.tensor([1.0, 1, 0, 1, 1]))
    assert torch.allclose(rgb[..., 4:], volume[:, 2, ..., 4:], atol=1e-5)
    background = torch.tensor([0.25, 0.5, 0.75])[:, None, None]
    assert torch.allclose(rgb[..., :4], background.expand_as(rgb[..., :4]), atol=1e-5)


def test_stereo_magnification_refuses_other_numbers_of_planes() -> None:
    photos, _ = plane_photos(5, 0.5)
    with pytest.raises(ValueError, match="made for 8 planes and 5 photos, not 16 planes and 5 photos"):
        NAMES["stereo_magnification"]()(photos, small_target(), rig.planes(16))


def test_fusion_of_known_planes_is_the_plane() -> None:
    disparities = rig.planes(PLANES)
    photos, seen_from = plane_photos(10, float(disparities[3]))
    target = small_target()
    rendering = light_field_fusion.LightFieldFusion(KnownPlane(3))(photos, target, disparities)
    assert rendering.valid.all()
    assert (rendering.rgb - seen_from(target)).abs().mean() < 0.01


def test_fusion_weights_decrease_with_distance() -> None:
    """The nearer reference weighs more, by exp(f (l_2 - l_1) / (D z_near)); equal distances weigh
    the same."""
    references = [rig.camera(-1, 0), rig.camera(1, 0)]
    disparities = rig.planes(64)
    middle = light_field_fusion.fusion_weights(references, rig.camera(0, 0.3), disparities)
    assert torch.allclose(middle, torch.tensor([0.5, 0.5]))
    near, far = light_field_fusion.fusion_weights(references, rig.camera(-0.5, 0), disparities).tolist()
    assert near / far == pytest.approx(torch.tensor(rig.PARALLAX / rig.NEAR / 64).exp().item(), rel=1e-4)


def test_fusion_prefers_opaque_images() -> None:
    images = torch.stack([torch.zeros(3, 1, 2), torch.ones(3, 1, 2)])
    opacities = torch.tensor([[[0.0, 0.0]], [[1.0, 0.0]]])
    fused = light_field_fusion.fused(images, opacities, torch.tensor([0.75, 0.25]))
    assert torch.allclose(fused[0], torch.tensor([[1.0, 0.25]]), atol=1e-4)


def test_fusion_groups_start_with_their_reference() -> None:
    photos, _ = plane_photos(10, 0.5, crop=(0, 0, 16, 16))
    first, second = light_field_fusion.groups(photos)
    assert [len(first.images), len(second.images)] == [5, 5]
    assert second.cameras[0] is photos.cameras[5] and second.references == (0,)
    with pytest.raises(ValueError, match="expected increasing indices"):
        light_field_fusion.groups(Photos(photos.images, photos.cameras, (5, 0)))


def test_deepview_components_of_an_opaque_plane() -> None:
    """An opaque plane in a photo to the side: the rendered image is the plane's, nothing behind it
    is visible."""
    disparities = rig.planes(PLANES)
    photos, seen_from = plane_photos(4, float(disparities[3]))
    camera = deepview.middle(photos.cameras).with_window(200, 150, 64, 64)
    planes = torch.full((PLANES, 4, 64, 64), 0.5)
    planes[:, 3] = 0
    planes[3, :3], planes[3, 3] = seen_from(camera), 1
    frame = photos.cameras[0].with_window(208, 158, 64, 64)
    parts = deepview.components(planes, camera, frame, disparities)
    rendered, behind, transmittance = (part[:, :, 30:40, 30:40] for part in parts.split([3, 3, 1], 1))
    assert (rendered[3] - planes[3, :3, 30:40, 30:40]).abs().mean() < 0.01
    assert torch.allclose(transmittance[:4], torch.ones(()), atol=1e-5) and transmittance[4:].abs().max() < 1e-5
    assert (behind[2] - rendered[2]).abs().max() < 1e-4


def test_deepview_takes_any_number_of_photos_in_any_order() -> None:
    torch.manual_seed(0)
    method = deepview.DeepView().eval()
    photos, _ = plane_photos(4, 0.5)
    swapped = Photos(photos.images[::-1], photos.cameras[::-1], photos.references)
    disparities = rig.planes(9)
    with torch.no_grad():
        one, other = (method(p, small_target(), disparities, cover=False).rgb for p in (photos, swapped))
    together = method(photos, small_target(), disparities, cover=False).rgb  # all planes at once
    assert torch.allclose(one, other, atol=1e-5) and torch.allclose(one, together, atol=1e-5)


def test_deepview_is_centred_between_the_photos() -> None:
    photos, _ = plane_photos(4, 0.5, crop=(0, 0, 16, 16))
    middle = deepview.middle(photos.cameras)
    assert torch.allclose(middle.centre, rig.camera(0, 0).centre) and middle.k.equal(photos.cameras[0].k)


CROP = (200, 130, 96, 80)  # of the photos, for Soft3D


def test_soft3d_renders_a_plane() -> None:
    disparities = rig.planes(16)
    photos, seen_from = plane_photos(4, float(disparities[6]), crop=CROP)
    target = rig.camera(0.2, -0.3).with_window(CROP[0] + 24, CROP[1] + 24, 48, 32)
    rendering = soft3d.Soft3D()(photos, target, disparities)
    assert rendering.valid.all() and not rendering.rgb.requires_grad
    assert (rendering.rgb - seen_from(target)).square().mean() < 1e-4  # 40 dB


def test_soft3d_consensus_and_visibility() -> None:
    """Consensus is the share of votes among the photos that see a point; points behind a surface
    are not visible."""
    cameras = [rig.camera(x, 0).with_window(*CROP) for x in (-0.25, 0.25)]
    disparities = rig.planes(PLANES).float()
    surface = torch.zeros(PLANES, CROP[3], CROP[2])
    surface[5] = 1
    votes = [torch.stack([surface, soft3d.before(surface)])] * 2
    votes[1] = torch.stack([surface.roll(1, 0), soft3d.before(surface.roll(1, 0))])  # this photo votes for plane 6
    middle = rig.camera(0, 0).with_window(CROP[0] + 32, CROP[1] + 16, 16, 16)
    found = soft3d.consensus(votes, cameras, middle, disparities)
    expected = torch.zeros(PLANES)
    expected[5], expected[6] = 0.5, 1  # the first photo does not see plane 6
    assert torch.allclose(found, expected[:, None, None].expand_as(found), atol=1e-4)
    assert torch.allclose(soft3d.before(surface)[:, 0, 0], torch.tensor([1.0] * 6 + [0.0] * 2))


def test_soft3d_interpolates_between_planes() -> None:
    """For a camera moved back along its axis, a plane lies at another depth of the source's
    volume."""
    source = rig.camera(0, 0).with_window(*CROP)
    disparities = rig.planes(16).float()
    volume = torch.arange(16.0)[None, :, None, None].expand(1, 16, CROP[3], CROP[2]).contiguous()
    back = Camera(source.k, source.rotation, torch.tensor([0.0, 0.0, 0.5]).double(), source.width, source.height)
    found = soft3d.looked_up(volume, source, back, disparities, 9)
    there = 1 / (1 / disparities[9] - 0.5)
    expected = (disparities[0] - there) / (disparities[0] - disparities[1])
    inner = found[0, 20:-20, 20:-20]
    assert torch.allclose(inner, expected.expand_as(inner), atol=1e-3)
    level = soft3d.looked_up(volume, source, rig.camera(0.1, 0).with_window(*CROP), disparities, 9)
    assert torch.allclose(level[0, 10:-10, 10:-10], torch.tensor(9.0))


def test_guided_filter_keeps_edges() -> None:
    image = torch.zeros(3, 48, 48)
    image[:, :, 24:] = 1
    noisy = image[:1] + 0.2 * torch.randn(1, 48, 48, generator=torch.Generator().manual_seed(0))
    smooth = soft3d.GuidedFilter(image)(noisy)
    assert (smooth - image[:1]).abs().mean() < 0.06
    assert (smooth[0, :, 25] - smooth[0, :, 22]).mean() > 0.8
