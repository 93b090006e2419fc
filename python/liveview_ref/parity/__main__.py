"""Parity on your own scene.

    python -m liveview_ref.parity SCENE --target NAME [options of liveview dump]

Lets the Rust binary dump every stage of one render, computes each stage again from the same inputs,
in float64 (the oracle) and float32 torch, and prints a table: elements, largest and mean error of
Rust and of torch. Exit code 1 if Rust exceeds the bounds of parity/tolerances.json.

For surface layers only the stages from the blend on are compared here; tests/parity/surface.rs
compares the earlier ones. With --network none the logits are those of the views' agreement.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import onnxruntime
import torch

from .. import onnx_session
from ..checkpoint import load_network
from ..paths import BINARY, ROOT
from ..reference.unet import UNet
from . import stages


def source_model(about: dict) -> Path:
    """The float32 model of the model that Rust ran: an int8 model is in the same folder
    as its original."""
    path = Path(about["model"])
    return path.with_name(path.name.replace("_int8", "")) if about["precision"] == "int8" else path


def bounded_as(name: str, about: dict) -> str:
    """The entry of the tolerance file: logits in another precision, or by another engine than cpu,
    have their own."""
    if name != "logits" or about["model"] is None or (about["precision"], about["engine"]) == ("f32", "cpu"):
        return name
    return f"logits {about['precision'] if about['precision'] != 'f32' else about['engine']}"


def compare(data: stages.Arrays, net: UNet | None):
    """For each output of each stage in `data`: (name, elements, Rust's errors, torch's
    errors), as stages.errors."""
    for stage in stages.STAGES:
        oracle, single = stage(data, torch.float64), stage(data, torch.float32)
        for name, exact in oracle.items():
            yield name, exact.size, stages.errors(data[name], exact, name), stages.errors(single[name], exact, name)
        if stage is stages.warp:
            name, exact, single = "logits" if net else "agreement", *logits_of(data, net)
            yield name, exact.size, stages.errors(data["logits"], exact, name), stages.errors(single, exact, name)


def logits_of(data: stages.Arrays, net: UNet | None) -> list[np.ndarray]:
    """Logits by the oracle and by torch: the network's, or those of the views' agreement."""
    both = torch.float64, torch.float32
    if net is None:
        return [stages.agreement(data, dtype)["agreement"] for dtype in both]
    return [stages.logits(net, data["colour"], dtype) for dtype in both]


def bound(tolerance: dict, theirs: tuple[float, float]) -> tuple[float, float]:
    """Largest and mean error allowed, given torch's."""
    largest = max(tolerance["floor"], tolerance["max_factor"] * theirs[0])
    largest = min(largest, tolerance.get("ceiling", largest))
    mean = max(tolerance["mean_floor"], tolerance["mean_factor"] * theirs[1])
    return largest, mean * (1 + 1e-9)  # means are summed in another order: equal errors must count as equal


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--binary", type=Path, default=BINARY)
    args, rest = parser.parse_known_args()
    tolerances = json.loads((ROOT / "parity" / "tolerances.json").read_text())
    with tempfile.TemporaryDirectory() as folder:
        dump = Path(folder) / "dump.npz"
        command = [args.binary, "--json", "dump", args.scene, "-o", dump, *rest]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            print(done.stderr, end="", file=sys.stderr)
            return done.returncode
        about = json.loads(done.stdout)
        with np.load(dump) as arrays:
            data = dict(arrays)
    if bounded_as("logits", about) not in tolerances:
        print(f"parity/tolerances.json: no bound for {bounded_as('logits', about)}", file=sys.stderr)
        return 2
    net = load_network(source_model(about)) if about["model"] else None
    failed = False
    print(f"{args.scene}, target {about['target']}, {about['layers']}, views {', '.join(about['views'])}\n")
    print("| stage | elements | Rust max | torch max | Rust mean | torch mean | worst at | |")
    print("|---|---|---|---|---|---|---|---|")
    for name, elements, ours, theirs in compare(data, net):
        limits = bound(tolerances[bounded_as(name, about)], theirs)
        good = ours[0] <= limits[0] and ours[1] <= limits[1]
        failed |= not good
        where = ", ".join(str(int(i)) for i in ours[2])
        figures = f"{ours[0]:.1e} | {theirs[0]:.1e} | {ours[1]:.1e} | {theirs[1]:.1e}"
        print(f"| {name} | {elements} | {figures} | [{where}] | {'ok' if good else 'OFF'} |")
    if about["layers"].startswith("surface"):
        print("\ncompared in tests/parity/surface.rs, not here: the photos' depth, the surface, its layers, their warp")
    chosen = np.array_equal(stages.best_layer(data), data["best_layer"])
    print(f"\nthe same layer chosen at each pixel: {'yes' if chosen else 'NO'}")
    if net is None:
        return int(failed or not chosen)
    if about["engine"] != "cpu":
        print(f"engine {about['engine']}: only the logits of engine cpu are compared bit by bit with onnxruntime's")
        return int(failed or not chosen)
    network = onnx_session.session(Path(about["model"]), about["threads"])
    python = onnx_session.logits(network, data["colour"], about["batch"])
    same = np.array_equal(python, data["logits"])
    off = float(np.abs(python - data["logits"]).max())
    library = next((Path(onnxruntime.__file__).parent / "capi").glob("libonnxruntime.so.*"), None)
    if library is None or not library.samefile(about["library"]):
        print(f"note: Rust ran {about['library']}, Python {library}")
    print(f"ort = onnxruntime, bit for bit: {'yes' if same else f'NO, up to {off:.1e}'}")
    return int(failed or not same or not chosen)


if __name__ == "__main__":
    sys.exit(main())
