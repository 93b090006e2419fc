"""All stages of a dump in the order of the pipeline, the table, and the first that departs."""

import json
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import onnxruntime
import torch

from ... import onnx_session
from ...checkpoint import load_network
from ...reference.liveview import UNet
from .. import stages
from . import scene, surface
from .compared import HEAD, TOLERANCES, Compared

BOTH = torch.float64, torch.float32


class Dump(NamedTuple):
    """The arrays of `liveview dump`, and what it printed about them."""

    data: stages.Arrays
    about: dict

    @classmethod
    def of(cls, binary: Path, scene_: Path, options: list[str]) -> "Dump":
        """ValueError with the program's message if it fails."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "dump.npz"
            done = subprocess.run(
                [binary, "--json", "dump", scene_, "-o", path, *options], capture_output=True, text=True
            )
            if done.returncode:
                raise ValueError(done.stderr)
            with np.load(path) as arrays:
                return cls(dict(arrays), json.loads(done.stdout))


def logits_entry(about: dict) -> str:
    """The entry of the tolerance file: logits in another precision, or by another engine than cpu,
    have their own."""
    if about["model"] is None or (about["precision"], about["engine"]) == ("f32", "cpu"):
        return "logits"
    return f"logits {about['precision'] if about['precision'] != 'f32' else about['engine']}"


def source_model(about: dict) -> Path:
    """The float32 model of the model that Rust ran: an int8 model is in the same folder
    as its original."""
    path = Path(about["model"])
    return path.with_name(path.name.replace("_int8", "")) if about["precision"] == "int8" else path


def weights(model: Path, net: UNet) -> Iterator[Compared]:
    """The exported weights against those of the checkpoint beside the model, if there is one."""
    checkpoint = model.with_suffix(".pt")
    if checkpoint.exists():
        trained = load_network(checkpoint).state_dict()
        found = net.state_dict()
        if {k: v.shape for k, v in found.items()} != {k: v.shape for k, v in trained.items()}:
            yield scene.exact("weights", np.array([len(found)]), np.array([np.inf]), "weights")
            return
        flat = (torch.cat([state[name].flatten() for name in found]).numpy() for state in (found, trained))
        mine, original = flat
        yield Compared.of("weights", (mine, original, original))


def rows(dump: Dump, reduced: Dump | None, net: UNet | None, photos: int | None = None) -> Iterator[Compared]:
    """Every output of every stage, the first stage first. `reduced`: the dump of surface layers
    with the search of the photos' depth; `photos`: only of the first ones."""
    data, about = dump
    if net is not None:
        yield from weights(source_model(about), net)
    yield from scene.choice(data)
    yield from scene.depth_range(data, searched=False)
    if reduced:
        yield from scene.depth_range(reduced.data, searched=True)
    yield from scene.undistorted(data)
    yield from scene.planes(data, about["layers"])
    yield from of_stage(stages.homography, data)
    if reduced:
        yield from surface.search(reduced.data, photos)
    if about["layers"].startswith("surface"):
        yield from surface.at_target(data)
    for stage in stages.STAGES[1:]:
        yield from of_stage(stage, data)
        if stage is stages.warp:
            yield logits(data, about, net)


def of_stage(stage, data: stages.Arrays) -> Iterator[Compared]:
    oracle, single = (stage(data, dtype) for dtype in BOTH)
    for name, exact in oracle.items():
        yield Compared.of(name, (data[name], exact, single[name]), scaled=name in stages.SCALED)


def logits(data: stages.Arrays, about: dict, net: UNet | None) -> Compared:
    """The network's, or those of the views' agreement."""
    if net is None:
        both = [stages.agreement(data, dtype)["agreement"] for dtype in BOTH]
        return Compared.of("agreement", (data["logits"], *both))
    both = [stages.logits(net, data["colour"], dtype) for dtype in BOTH]
    return Compared.of("logits", (data["logits"], *both), logits_entry(about), scaled=True)


def first_departing(found: Iterator[Compared]) -> str | None:
    """The name of the first stage at which Rust exceeds its bounds."""
    return next((row.name for row in found if row.departs), None)


def report(scene_: Path, dump: Dump, reduced: Dump | None) -> str | None:
    """Prints the table; returns the first stage that departs."""
    data, about = dump
    if logits_entry(about) not in TOLERANCES:
        raise ValueError(f"parity/tolerances.json: no bound for {logits_entry(about)}\n")
    net = load_network(source_model(about)) if about["model"] else None
    print(f"{scene_}, target {about['target']}, {about['layers']}, views {', '.join(about['views'])}")
    if reduced:
        width = max(int(w) for w, _ in reduced.data["scene.size"])
        print(f"the search of the photos' depth: at a width of {width} pixels")
    print(f"\n{HEAD}")
    first = None
    for row in rows(dump, reduced, net):
        print(row.row(), flush=True)
        first = first or (row.name if row.departs else None)
    chosen = np.array_equal(stages.best_layer(data), data["best_layer"])
    print(f"\nthe same layer chosen at each pixel: {'yes' if chosen else 'NO'}")
    first = first or (None if chosen else "best_layer")
    return first or (None if net is None or onnxruntime_agrees(data, about) else "onnxruntime")


def onnxruntime_agrees(data: stages.Arrays, about: dict) -> bool:
    """Whether onnxruntime gives the same bits; only engine cpu is compared."""
    if about["engine"] != "cpu":
        print(f"engine {about['engine']}: only the logits of engine cpu are compared bit by bit with onnxruntime's")
        return True
    network = onnx_session.session(Path(about["model"]), about["threads"])
    python = onnx_session.logits(network, data["colour"], about["batch"])
    same = np.array_equal(python, data["logits"])
    off = float(np.abs(python - data["logits"]).max())
    library = next((Path(onnxruntime.__file__).parent / "capi").glob("libonnxruntime.so.*"), None)
    if library is None or not library.samefile(about["library"]):
        print(f"note: Rust ran {about['library']}, Python {library}")
    print(f"ort = onnxruntime, bit for bit: {'yes' if same else f'NO, up to {off:.1e}'}")
    return same
