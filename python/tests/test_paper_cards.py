"""The weights that the comparison keeps, and their card."""

import json

import pytest
import torch
from test_paper_training import Scenes, Tint
from torch import nn

from liveview_ref.checkpoint import load_state
from liveview_ref.paper import cards, scoring, train
from liveview_ref.paper.method import Rendering
from liveview_ref.paper.registry import ENTRIES, Entry
from liveview_ref.paper.samples import RigSamples


class Normed(Tint):
    """With statistics, which are estimated anew where weights are loaded."""

    def __init__(self, views: int):
        super().__init__(views)
        self.norm = nn.BatchNorm2d(3)

    def forward(self, photos, target, disparities, cover=True):
        found = super().forward(photos, target, disparities, cover)
        return Rendering(self.norm(found.rgb[None])[0], found.valid, found.alpha, found.camera)


class Large(Tint):
    def __init__(self, views: int):
        super().__init__(views)
        self.rest = nn.Parameter(torch.zeros(cards.LIMIT // 4))


SMALL, LARGE, NEVER = (
    Entry(name, 4, build, planes=(2, 4)) for name, build in (("n", Normed), ("l", Large), ("x", Tint))
)


@pytest.fixture
def samples():
    return RigSamples(Scenes())


@pytest.fixture
def runs(tmp_path, monkeypatch, samples):
    """What training wrote of two of three methods; the last step of the first was validated."""
    monkeypatch.setattr(cards, "ENTRIES", [SMALL, LARGE, NEVER])
    monkeypatch.setattr(train, "TURN", 2)
    monkeypatch.setattr(train, "STATISTICS", 2)
    for entry, validate_every in ((SMALL, 2), (LARGE, 100)):
        monkeypatch.setattr(train, "VALIDATE_EVERY", validate_every)
        train.Trainee(entry, tmp_path / "runs" / entry.key).turn(samples, Scenes(1))
    return tmp_path / "runs"


@pytest.fixture
def models(tmp_path):
    return tmp_path / "paper"


def test_kept_weights_are_loaded_as_those_of_training_are(runs, models, samples):
    cards.keep(runs, models / "weights")
    method, about = scoring.load(SMALL, models / "weights", samples)
    trained, told = scoring.load(SMALL, runs, samples)
    assert about == told and about["step"] == 2 and about["history"]
    assert not torch.equal(trained.tint, SMALL.build(4).tint)  # it is none that was just built
    assert method.state_dict().keys() == trained.state_dict().keys()
    for name, value in trained.state_dict().items():
        assert torch.equal(method.state_dict()[name], value), name
    kept = load_state(models / "weights" / "n_v4" / "checkpoint.pt")
    assert kept["samples"] == 2 * train.BATCH and not {"method", "optimiser"} & kept.keys()
    on = train.Trainee(SMALL, models / "on", models / "weights" / "n_v4")
    assert torch.equal(on.method.tint, trained.tint)


def test_weights_kept_twice_are_the_same_file(runs, models):
    cards.keep(runs, models / "weights")
    first = (models / "weights" / "n_v4" / "checkpoint.pt").read_bytes()
    cards.keep(models / "weights", models / "again")
    assert (models / "again" / "n_v4" / "checkpoint.pt").read_bytes() == first


def test_large_weights_are_left_out_and_told_of(runs, models):
    told = cards.keep(runs, models / "weights")
    folder = models / "weights" / "l_v4"
    assert [path.name for path in folder.iterdir()] == ["left_out.json"]
    about = json.loads((folder / "left_out.json").read_text())
    assert (about["bytes"], about["parameters"]) == (cards.LIMIT + 12, cards.LIMIT // 4 + 3)
    assert "l_v4: step 2, 4.0 MB, left out" in told and any(line.startswith("x_v4: not in ") for line in told)


def test_the_card_has_a_row_of_each_that_was_trained(runs, models):
    cards.keep(runs, models / "weights")
    small = load_state(runs / "n_v4" / "checkpoint.pt")
    hours, psnr = f"{small['seconds'] / 3600:.2f}", f"{small['history'][-1]['psnr']:.2f}"
    text = cards.card(models)
    size = (models / "weights" / "n_v4" / "checkpoint.pt").stat().st_size / 1e6
    file = f"[weights/n_v4/checkpoint.pt](weights/n_v4/checkpoint.pt), {size:.1f} MB"
    # 3 of the tint and 6 of the norm; its statistics are no parameters
    assert f"| n | 4 | 4 | 9 | 2 | {2 * train.BATCH} | {hours} | {psnr} | {file} |" in text
    rows = [line for line in text.splitlines() if line.startswith("| l |")]
    assert len(rows) == 1 and rows[0].endswith("| – | not kept: 4.0 MB, above 4.0 MB |") and "| 1,000,003 |" in rows[0]
    assert "Nothing kept yet of `x_v4`." in text and "No curves are drawn yet." in text
    (models / "training.svg").touch()
    assert "](training.svg)" in cards.card(models)


def test_a_validation_before_the_last_step_says_its_step(runs, models):
    path = runs / "n_v4" / "checkpoint.pt"
    state = load_state(path)
    torch.save(state | {"step": 3}, path)
    cards.keep(runs, models / "weights")
    assert f"| {state['history'][-1]['psnr']:.2f} at step 2 |" in cards.card(models)


def damaged(state: dict) -> dict[str, object]:
    average = state["average"]
    return {
        "seconds: missing": {name: value for name, value in state.items() if name != "seconds"},
        "key: other_v4; expected n_v4": state | {"key": "other_v4"},
        "average: .*tint.*expected the weights of n_v4": state | {"average": average | {"tint": torch.zeros(4, 1, 1)}},
        "key, step, .*missing; expected": [1, 2],
    }


@pytest.mark.parametrize("number", range(4))
def test_a_damaged_checkpoint_is_named_and_nothing_is_kept(runs, models, number):
    path = runs / "n_v4" / "checkpoint.pt"
    message, state = list(damaged(load_state(path)).items())[number]
    torch.save(state, path)
    with pytest.raises(ValueError, match=f"(?s){path}: {message}"):
        cards.keep(runs, models / "weights")
    assert not models.exists()


def test_a_file_that_is_cut_short_is_named(runs, models):
    cards.keep(runs, models / "weights")
    path = models / "weights" / "n_v4" / "checkpoint.pt"
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ValueError, match=f"{path}: .*; expected a checkpoint of training"):
        cards.card(models)
    told = models / "weights" / "l_v4" / "left_out.json"
    path.unlink()
    told.write_text("{}")
    with pytest.raises(ValueError, match=f"{told}: .*bytes: missing"):
        cards.card(models)


def test_the_program_refuses_a_folder_that_training_did_not_write(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cards, "MODELS", tmp_path / "paper")
    monkeypatch.setattr("sys.argv", ["cards", "--runs", str(tmp_path)])
    assert cards.main() == 2 and f"{tmp_path}: no METHOD/checkpoint.pt" in capsys.readouterr().err
    assert not (tmp_path / "paper").exists()


def test_entries_that_start_from_given_weights_have_their_licence(monkeypatch):
    read, load = [], torch.load
    monkeypatch.setattr(torch, "load", lambda path, **how: read.append(path.name) or load(path, **how))
    started = {}
    for each in (entry for entry in ENTRIES if entry.trained):
        each.build(each.views)
        started |= {each.key: read.pop()} if read else {}
    assert started == {"liveview_competing_v4": "liveview_v4_planes.pt"} and not read
    assert "But `liveview_competing_v4` starts from `liveview_v4_planes.pt`" in cards.card(cards.MODELS)
