"""The figures that the comparison keeps of its trainings, and their card."""

import json

import pytest
import torch
from test_paper_training import Scenes, Tint
from torch import nn

from liveview_ref.checkpoint import load_state
from liveview_ref.paper import train
from liveview_ref.paper.data.samples import RigSamples
from liveview_ref.paper.measure import scoring
from liveview_ref.paper.methods import liveview
from liveview_ref.paper.methods.method import Rendering
from liveview_ref.paper.methods.registry import ENTRIES, Entry
from liveview_ref.paper.report import cards
from liveview_ref.paths import MODELS


class Normed(Tint):
    """With BatchNorm, whose statistics are estimated again when weights are loaded."""

    def __init__(self, views: int):
        super().__init__(views)
        self.norm = nn.BatchNorm2d(3)

    def forward(self, photos, target, disparities, cover=True):
        found = super().forward(photos, target, disparities, cover)
        return Rendering(self.norm(found.rgb[None])[0], found.valid, found.alpha, found.camera)


NORMED, PLAIN, UNTRAINED = (
    Entry(name, 4, build, planes=(2, 4)) for name, build in (("n", Normed), ("p", Tint), ("x", Tint))
)


@pytest.fixture
def samples():
    return RigSamples(Scenes())


@pytest.fixture
def runs(tmp_path, monkeypatch, samples):
    """The trainings of two of three methods; the last step of the first was validated."""
    monkeypatch.setattr(cards, "ENTRIES", [NORMED, PLAIN, UNTRAINED])
    monkeypatch.setattr(train, "TURN", 2)
    monkeypatch.setattr(train, "STATISTICS", 2)
    for entry, validate_every in ((NORMED, 2), (PLAIN, 100)):
        monkeypatch.setattr(train, "VALIDATE_EVERY", validate_every)
        train.Trainee(entry, tmp_path / "runs" / entry.key).turn(samples, Scenes(1))
    return tmp_path / "runs"


@pytest.fixture
def models(tmp_path):
    folder = tmp_path / "paper"
    folder.mkdir()
    return folder


def test_trained_weights_are_loaded_for_scoring_and_for_further_training(runs, samples, tmp_path):
    trained, about = scoring.load(NORMED, runs, samples)
    assert about["step"] == 2 and about["samples"] == 2 * train.BATCH
    assert not torch.equal(trained.tint, NORMED.build(4).tint)  # not the initial weights
    further = train.Trainee(NORMED, tmp_path / "further", runs / "n_v4")
    assert torch.equal(further.method.tint, trained.tint)


def test_card_has_a_row_for_each_training(runs, models):
    lines = cards.record(runs, models / "training.json")
    assert "n_v4: step 2" in lines and any(line.startswith("x_v4: not in ") for line in lines)
    state = load_state(runs / "n_v4" / "checkpoint.pt")
    hours, psnr = f"{state['seconds'] / 3600:.2f}", f"{state['history'][-1]['psnr']:.2f}"
    text = cards.card(models)
    # 3 of the tint and 6 of the norm; its statistics are not parameters
    assert f"| n | 4 | 4 | 9 | 2 | {2 * train.BATCH} | {hours} | {psnr} |" in text
    rows = [line for line in text.splitlines() if line.startswith("| p |")]
    assert len(rows) == 1 and rows[0].endswith("| – |")
    assert "Not trained yet: `x_v4`." in text and "No curves are drawn yet." in text
    (models / "training.svg").touch()
    assert "](training.svg)" in cards.card(models)


def test_recorded_trainings_stay_when_others_are_recorded(runs, models):
    cards.record(runs, models / "training.json")
    (runs / "p_v4" / "checkpoint.pt").unlink()
    cards.record(runs, models / "training.json")
    assert list(json.loads((models / "training.json").read_text())) == ["n_v4", "p_v4"]


def test_validation_before_the_last_step_is_shown_with_its_step(runs, models):
    path = runs / "n_v4" / "checkpoint.pt"
    state = load_state(path)
    torch.save(state | {"step": 3}, path)
    cards.record(runs, models / "training.json")
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
def test_damaged_checkpoint_is_named_and_nothing_is_recorded(runs, models, number):
    path = runs / "n_v4" / "checkpoint.pt"
    message, state = list(damaged(load_state(path)).items())[number]
    torch.save(state, path)
    with pytest.raises(ValueError, match=f"(?s){path}: {message}"):
        cards.record(runs, models / "training.json")
    assert not list(models.iterdir())


def test_truncated_checkpoint_is_named(runs, models):
    path = runs / "n_v4" / "checkpoint.pt"
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ValueError, match=f"{path}: .*; expected a checkpoint of training"):
        cards.record(runs, models / "training.json")


def test_folder_without_checkpoints_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cards, "MODELS", tmp_path)
    monkeypatch.setattr("sys.argv", ["cards", "--runs", str(tmp_path)])
    assert cards.main() == 2 and f"{tmp_path}: no METHOD/checkpoint.pt" in capsys.readouterr().err
    assert not (tmp_path / "paper").exists()


def test_card_gives_the_licence_of_entries_initialised_from_given_weights(monkeypatch):
    read = []
    monkeypatch.setattr(liveview, "load_state", lambda path: read.append(path.name) or load_state(path))
    initialised = {}
    for each in (entry for entry in ENTRIES if entry.trained):
        each.build(each.views)
        initialised |= {each.key: read.pop()} if read else {}
    assert initialised == {"liveview_competing_v4": "liveview_v4_planes.onnx"} and not read
    text = " ".join(cards.card(MODELS / "paper").split())
    assert "But `liveview_competing_v4` is initialised from `liveview_v4_planes.onnx`" in text
