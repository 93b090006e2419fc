"""Examples on disk: views cropped to what the target sees lose nothing, and a shard is determined
by its seed and number."""

import copy
from pathlib import Path

import numpy as np
import pytest
import torch

from liveview_ref.data.examples import RealScene
from liveview_ref.data.shards import Shards, cropped, pack, unpack
from liveview_ref.reference.liveview import uniform_disparities
from liveview_ref.training.train import read_config
from liveview_ref.training.train_planes import warp_layers

ROOT = Path(__file__).parents[3]
PHOTOS = {"path": "workshop", "reach": 2, "widths": [300], "weight": 1}


@pytest.fixture(scope="module")
def config():
    return read_config(ROOT / "python/configs/v4_planes.json") | {"crop": [48, 64]}


def test_cropped_views_warp_like_whole_ones(config):
    scene, cut = RealScene(ROOT / "tests/scenes", PHOTOS, 4), 0
    for seed in range(4):
        p = cropped(np.random.default_rng(seed), config, scene)
        whole = copy.copy(p)
        sources, cameras, *_ = scene.draw(np.random.default_rng(seed), 4, (48, 64))
        order = sorted(range(4), key=lambda i: float((cameras[i].centre - p.camera.centre).norm()))
        whole.views = [(sources[i] * 255).round().to(torch.uint8) for i in order]
        whole.cameras = [cameras[i] for i in order]
        planes = uniform_disparities(p.near, p.far, 6).float()[:, None, None]
        for mine, theirs in zip(warp_layers(p, planes), warp_layers(whole, planes), strict=True):
            torch.testing.assert_close(mine, theirs, atol=2e-3, rtol=0)
        cut += sum(a.numel() < b.numel() for a, b in zip(p.views, whole.views, strict=True))
    assert cut > 0, "no view was cropped: the test is too weak"


def test_shard_is_made_once_and_reproducible(config, tmp_path, monkeypatch):
    config = config | {"shard": 4, "real": [PHOTOS], "textures": "no textures"}
    shards = Shards(tmp_path / "a", config, ROOT / "tests/scenes")
    first = shards[3]
    monkeypatch.setattr(shards, "make", lambda number: pytest.fail("made again"))
    again = [Shards(tmp_path / "b", config, ROOT / "tests/scenes")[3], shards[3], [unpack(pack(p)) for p in first]]
    assert {p.seen is None for p in first} == {True, False}, "only one kind of scene: choose another seed"
    for other in again:
        for a, b in zip(first, other, strict=True):
            assert all(torch.equal(x, y) for x, y in zip(a.views, b.views, strict=True))
            assert torch.equal(a.target, b.target) and (a.near, a.far) == (b.near, b.far)
            assert (a.seen is None) == (b.seen is None)
            if a.seen is not None:
                assert torch.equal(a.seen, b.seen) and torch.equal(a.disparity, b.disparity)
    assert Shards(tmp_path / "a", config | {"seed": 7}, ROOT).folder != shards.folder
