"""The recipe of all networks: what is finished is left alone, what was stopped goes on."""

import json
import signal
from pathlib import Path

import pytest
import torch

from liveview_ref.checkpoint import load_state
from liveview_ref.training import recipe, train
from liveview_ref.training.fine_tune import fine_tune

ROOT = Path(__file__).parents[3]


def test_stopped_training_keeps_whole_steps_and_goes_on_alike(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(signal, "signal", lambda _, stop: asked.append(stop))
    config = {"start_scale": 1.0, "learning_rate": 1e-3, "seed": 1, "steps": 2, "batch": 2, "clip": 1.0, "warm_up": 1,
              "falling": 0.5, "average": 0.9, "validate_every": 9, "views": 4}  # fmt: skip
    start = load_state(ROOT / "models/liveview_v4.pt")

    class Toy:
        stop_at, calls = None, 0

        def examples(self, step):
            return [0.1, 0.2, 0.3]

        def loss(self, net, example, rng):
            self.calls += 1
            if self.calls == self.stop_at:
                asked[-1]()
            return ((net(torch.full((1, 12, 8, 8), example)) - 1) ** 2).mean(), {}

        def validate(self, net, file):
            return {}

    toy = Toy()
    for name, stops in (("whole", [None]), ("stopped", [1, 3, None])):
        (tmp_path / name).mkdir()
        for toy.stop_at in stops:
            toy.calls = 0
            fine_tune(config, toy, tmp_path / name, start)
    whole, stopped = (load_state(tmp_path / name / "checkpoint.pt") for name in ("whole", "stopped"))
    assert whole["step"] == stopped["step"] == 2
    for name, value in whole["net"].items():
        torch.testing.assert_close(stopped["net"][name], value)


def test_recipe_trains_what_is_missing_from_the_network_before(tmp_path, monkeypatch):
    (tmp_path / "recipe.json").write_text(json.dumps({"first": None, "second": "first", "third": "second"}))
    for name in ("first", "second", "third"):
        (tmp_path / f"{name}.json").write_text(json.dumps({"steps": 3}))
    reached, calls = {"first": 3, "second": 3, "third": 2}, []

    def trained(arguments: list[str]) -> None:
        config, out = Path(arguments[0]).stem, Path(arguments[arguments.index("--out") + 1])
        calls.append((config, arguments[arguments.index("--start") + 1 :] if "--start" in arguments else []))
        out.mkdir(parents=True, exist_ok=True)
        torch.save({"step": reached[config]}, out / "checkpoint.pt")

    monkeypatch.setattr(train, "main", trained)
    command = [str(tmp_path / "recipe.json"), "--data", "data", "--out", str(tmp_path / "runs")]
    assert recipe.main(command) == 1  # the third was stopped
    before = [str(tmp_path / "runs" / name / "checkpoint.pt") for name in ("first", "second")]
    assert calls == [("first", []), ("second", [before[0]]), ("third", [before[1]])]
    reached["third"] = 3
    assert recipe.main(command) == 0 and calls[3:] == [("third", [before[1]])]
    with pytest.raises(SystemExit):
        recipe.main([*command, "--only", "fourth"])


def test_recipe_of_the_shipped_networks_names_configs_in_order():
    found = json.loads((ROOT / "python/configs/recipe.json").read_text())
    known = [None]
    for name, start in found.items():
        assert start in known and (ROOT / f"python/configs/{name}.json").exists()
        known.append(name)
    shipped = {path.stem.removeprefix("liveview_") for path in (ROOT / "models").glob("*.onnx")}
    assert {name for name in shipped if not name.endswith("_int8")} <= set(found)
