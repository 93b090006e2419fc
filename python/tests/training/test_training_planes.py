"""Training on competing planes: warps, visibility, and gradients through some of the layers
only."""

import json
import signal
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from liveview_ref import export
from liveview_ref.checkpoint import load_network, load_state, model_card
from liveview_ref.data.procedural.scene import random_scene
from liveview_ref.data.procedural.textures import Textures
from liveview_ref.data.shards import Photos, eight_bit
from liveview_ref.data.visibility import HIDDEN, SEEN, view_weights, visibility
from liveview_ref.reference.layers import warp_views
from liveview_ref.reference.liveview import UNet, blend, uniform_disparities
from liveview_ref.training import train
from liveview_ref.training.train_planes import draw_layers, example_loss, seen_range, warp_layers
from liveview_ref.weights import fold_batchnorm, unfold_batchnorm, with_views

ROOT = Path(__file__).parents[3]


def test_layers_are_drawn_with_their_probabilities():
    mass, rng = torch.tensor([0.0, 0.1, 5.0, 0.3, 0.0, 1.0, 0.02, 0.5]), np.random.default_rng(0)
    drawn, chances = torch.zeros(8), torch.zeros(8)
    for _ in range(4000):
        ids, chance = draw_layers(mass, 3, rng)
        assert len(set(ids.tolist())) == 3
        drawn[ids] += 1
        chances[ids] = chance
    torch.testing.assert_close(drawn / 4000, chances, atol=0.03, rtol=0)
    assert chances[2] == 1 and torch.isclose(chances.sum(), torch.tensor(3.0))


@pytest.fixture(scope="module")
def photos():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    s = random_scene(np.random.default_rng(3), 4, (64, 64), Textures(None))
    seen = visibility(s.disparity, s.target_camera, s.view_disparities, s.cameras)
    views = [eight_bit(v) for v in s.views]
    yield Photos(views, s.cameras, eight_bit(s.target), s.target_camera, s.near, s.far, s.disparity, seen)
    torch.set_num_threads(threads)


def test_training_warps_like_the_renderer(photos):
    planes = uniform_disparities(photos.near, photos.far, 5).float()[:, None, None].expand(-1, 64, 64)
    colour, coverage = warp_layers(photos, planes)
    expected, covered = warp_views([v.float() / 255 for v in photos.views], photos.cameras, photos.camera, planes)
    torch.testing.assert_close(coverage, covered, atol=2e-3, rtol=0)
    torch.testing.assert_close(colour, expected, atol=2e-3, rtol=0)


def test_seeing_views_have_the_surface_colour_and_occluded_ones_do_not(photos):
    colour, coverage = warp_layers(photos, photos.disparity[None])
    error = (colour[0] - photos.target.float() / 255).abs().mean(1)
    inside = coverage[0] > 0.999
    seen, hidden = (photos.seen == SEEN) & inside, (photos.seen == HIDDEN) & inside
    assert seen.sum() > 1000 and hidden.sum() > 50, (seen.sum(), hidden.sum())
    assert error[seen].median() < 0.03 < error[hidden].median()


def test_view_weights_equal_those_of_the_blend():
    g = torch.Generator().manual_seed(1)
    logits, colour = torch.randn(3, 4, 5, 6, generator=g), torch.rand(3, 4, 3, 5, 6, generator=g)
    coverage = (torch.rand(3, 4, 5, 6, generator=g) < 0.7).float()
    distances = torch.tensor([1.0, 1.5, 2.0, 4.0])
    weights = view_weights(logits, coverage, distances)
    shown = (coverage > 0).any(1, keepdim=True)
    expected = blend(logits, colour, coverage, distances)[1]
    torch.testing.assert_close((weights[:, :, None] * colour).sum(1) * shown, expected * shown)


def test_folded_network_equals_its_unfolded_copy():
    net = UNet(4).eval()
    for norm in (m for m in net.modules() if isinstance(m, torch.nn.BatchNorm2d)):
        norm.running_mean.uniform_(-0.2, 0.2), norm.running_var.uniform_(0.5, 2), norm.bias.data.uniform_(-0.2, 0.2)
    folded, x = fold_batchnorm(net), torch.rand(2, 12, 16, 24)
    with torch.no_grad():
        torch.testing.assert_close(unfold_batchnorm(folded)(x), folded(x), rtol=1e-5, atol=1e-6)
        torch.testing.assert_close(folded(x), net(x), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("alpha", ["competing", "independent"])
def test_steps_lower_the_loss_of_an_example(photos, alpha):
    torch.manual_seed(0)
    net = fold_batchnorm(UNet(4).eval())
    for p in net.parameters():
        p.requires_grad_(True)
    optimiser = torch.optim.Adam(net.parameters(), lr=2e-3)
    weights = {"depth_weight": 0.02, "visible_weight": 0.05, "square_weight": 2.0, "log_weight": 0.0}
    config = weights | {"alpha": alpha, "uniform_planes": [12], "gradient_planes": 12}
    config |= {"selected": 0.0, "selected_planes": [4], "distance_power": 1.0, "seen_range": 0.0}
    picture_alone = config | {"depth_weight": 0.0, "visible_weight": 0.0}  # the loss that the figures have
    losses = []
    for _ in range(12):
        loss, figures = example_loss(net, photos, np.random.default_rng(0), picture_alone)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(figures["loss"])
    assert losses[-1] < 0.97 * losses[0], losses
    loss, _ = example_loss(net, photos, np.random.default_rng(0), config | {"selected": 1.0, "gradient_planes": 3})
    optimiser.zero_grad()
    loss.backward()
    assert torch.isfinite(loss) and all(float(p.grad.abs().max()) > 0 for p in net.parameters())


@pytest.mark.parametrize("alpha", ["competing", "independent"])
def test_mean_gradient_of_drawn_planes_is_that_of_all(photos, alpha):
    torch.manual_seed(0)
    net = fold_batchnorm(UNet(4).eval())
    for p in net.parameters():
        p.requires_grad_(True)
    config = {"uniform_planes": [10], "gradient_planes": 10, "visible_weight": 0.05}
    config |= {"selected": 0.0, "selected_planes": [4], "distance_power": 1.0, "seen_range": 0.0}
    config |= {"alpha": alpha, "depth_weight": 0.02, "square_weight": 2.0, "log_weight": 0.05}

    def gradient(seed, **changed):
        net.zero_grad()
        example_loss(net, photos, Fixed(seed), config | changed)[0].backward()
        return torch.cat([p.grad.flatten() for p in net.parameters()]).double()

    whole = gradient(0)
    few = [gradient(seed, gradient_planes=4) for seed in range(60)]
    mean = sum(few) / len(few)
    spread = sum((g - mean).norm() ** 2 for g in few).sqrt() / len(few)  # of the mean
    assert (mean - whole).norm() < 2 * spread + 0.02 * whole.norm(), (mean.norm(), whole.norm(), spread)
    assert spread < 0.5 * whole.norm()


def test_range_is_narrowed_to_the_planes_that_show_the_pixels(photos):
    planes = uniform_disparities(1.0, 100.0, 16).float()[:, None, None]
    best = torch.full((20, 20), 6)
    best[0], best[1, :2] = 9, torch.tensor([0, 14])  # 5 % of the pixels; two specks of 0.25 % each
    weights = torch.nn.functional.one_hot(best, 16).permute(2, 0, 1).float()
    found = seen_range(weights, planes, replace(photos, near=1.0, far=100.0))
    np.testing.assert_allclose(found, [1 / planes[5].item(), 1 / planes[10].item()])
    assert seen_range(weights, planes, replace(photos, near=2.0, far=2.5)) == (2.0, 2.5)


@pytest.mark.parametrize("name", ["v4_planes", "v5", "v4_planes_paper"])
def test_training_starts_continues_and_is_exported(tmp_path, monkeypatch, name):
    workshop = {"path": "workshop", "reach": 2, "widths": [300], "weight": 1}
    config = {
        "base": str(ROOT / f"python/configs/{name}.json"), "steps": 2, "crop": [48, 48], "batch": 2, "shard": 4,
        "shards": 1, "shards_at_once": 1, "seen_range": 1.0, "uniform_planes": [6],
        "textures": "no textures", "real": [workshop],
        "validation": [{"path": "workshop", "width": 96, "targets": [7], "heldout": 0}],
    }  # fmt: skip
    (tmp_path / "config.json").write_text(json.dumps(config))
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    folders = {"data": ROOT / "tests/scenes", "out": tmp_path, "shards": tmp_path / "shards"}
    folders["start"] = ROOT / "models/liveview_v4.pt"
    command = ["", str(tmp_path / "config.json"), *(part for k, v in folders.items() for part in (f"--{k}", str(v)))]
    threads = torch.get_num_threads()
    for more in ([], ["--steps", "3"]):
        monkeypatch.setattr(sys, "argv", command + more)
        train.main()
    torch.set_num_threads(threads)
    state = load_state(tmp_path / "checkpoint.pt")
    assert state["step"] == 3 and [row["step"] for row in state["history"]] == [2, 3]
    prefix = "" if "paper" in name else "competing, "
    assert {f"{prefix}planes:16", f"{prefix}planes:64", "workshop"} < state["history"][0].keys()
    assert state["history"][1]["workshop"] > 15
    model = tmp_path / "model.onnx"
    arguments = ["--licence", "none", "--recommended-layers", "planes:64", "--layer-kinds", "planes", "list"]
    arguments += ["--mean-with-start", str(folders["start"]), "--view-shift", "-3", "3"]
    monkeypatch.setattr(sys, "argv", ["", str(tmp_path / "checkpoint.pt"), str(model), *arguments])
    export.main()
    of_training, of_start, exported = (
        torch.cat([weights.flatten() for weights in with_views(load_network(path), state["views"]).parameters()])
        for path in (tmp_path / "checkpoint.pt", folders["start"], model)
    )
    assert not torch.equal(of_training, of_start)
    expected = (of_training + of_start) / 2
    expected[2 - state["views"] :] -= 3  # the end of the last bias, one logit a view
    torch.testing.assert_close(exported, expected)
    card = model_card(onnx.load(model))
    expected = (None, None) if "paper" in name else ("competing", "1")
    assert (card.get("alpha"), card.get("alpha_scale")) == expected
    assert card["layer_kinds"] == "planes, list" and card["training"].endswith("views from 3 on shifted by -3")
    assert card["trained_layers"] == "planes:6 to planes:6" and card["recommended_layers"] == "planes:64"


class Fixed:
    """A random generator that leaves near and far unchanged."""

    def __init__(self, seed: int):
        self.rng = np.random.default_rng(seed)

    def uniform(self, low, high):
        return 0.0

    def __getattr__(self, name):
        return getattr(self.rng, name)
