"""The three uses of the project on its example scene, and a table of what each gave.

`make demo` runs it at the root of the repository, after `make build runtime`. It needs no package.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

SCENE = "tests/scenes/workshop"
RENDER = f"target/release/liveview render {SCENE} --target target_0,target_1 --json"
RENDER += " -o out/views --compare out/compare --depth out/depth"
EXAMPLE = "cargo run --quiet --release --locked --example onnx"
GOLDENS = "cargo test --quiet --release --locked --test goldens -- --nocapture"
LIBRARY = "lib/python*/site-packages/onnxruntime/capi/libonnxruntime.*"


def output(command: str, **variables: str) -> str:
    """What a command prints; its messages go to the terminal."""
    print("$", *(f"{name}={value}" for name, value in variables.items()), command, flush=True)
    done = subprocess.run(command.split(), stdout=subprocess.PIPE, text=True, env=os.environ | variables)
    if done.returncode != 0:
        sys.exit(done.stdout or f"{command}: exit code {done.returncode}")
    return done.stdout


Path("out").mkdir(exist_ok=True)
rows = [("use", "what it gave", "files")]
for target in json.loads(output(RENDER))["targets"]:
    result = f"{target['psnr']:.2f} dB against the held-out photo, {sum(target['seconds'].values()):.2f} s"
    rows.append(("a picture from photos", result, target["files"][0]))
library = next(Path(".venv").absolute().glob(LIBRARY))
file, result = output(EXAMPLE, ORT_DYLIB_PATH=str(library)).strip().split(": ", 1)
rows.append(("an ONNX model in your Rust program", result, file))
stages = re.findall(r"^(.+): (\d+) values, largest error (\S+), bound (\S+)$", output(GOLDENS), re.MULTILINE)
values = sum(int(count) for _, count, _, _ in stages)
worst = max(float(error) / float(bound) for _, _, error, bound in stages if float(bound) > 0)
rows.append(("proof that both languages agree", f"{len(stages)} stages, {values} values", "parity/goldens"))
rows.append(("", f"largest error {worst:.0%} of its bound", ""))

widths = [max(len(row[column]) for row in rows) for column in range(3)]
print("", *("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows), sep="\n")
print("\nout/compare: truth, result, difference; out/depth: near is bright.")
