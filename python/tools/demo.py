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
RENDER = ["target/release/liveview", "render", SCENE, "--target", "target_0,target_1", "-o", "out/views"]
RENDER += ["--compare", "out/compare", "--depth", "out/depth"]
EXAMPLE = ["cargo", "run", "--quiet", "--release", "--locked", "--example", "onnx"]
GOLDENS = ["cargo", "test", "--quiet", "--release", "--locked", "--test", "goldens", "--", "--nocapture"]


def output(command: list[str], **variables: str) -> str:
    """What a command prints; its messages go to the terminal."""
    print("$", " ".join(command), flush=True)
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, env=os.environ | variables)
    if done.returncode != 0:
        print(done.stdout, file=sys.stderr)
        sys.exit(done.returncode)
    return done.stdout


def main() -> None:
    """Runs the three commands."""
    Path("out").mkdir(exist_ok=True)
    rows = [("use", "what it gave", "files")]
    for target in json.loads(output([*RENDER, "--json"]))["targets"]:
        seconds = sum(target["seconds"].values())
        result = f"{target['psnr']:.2f} dB against the held-out photo, {seconds:.2f} s"
        rows.append(("a picture from photos", result, target["files"][0]))

    libraries = sorted(Path(".venv").glob("lib/python*/site-packages/onnxruntime/capi/libonnxruntime.*"))
    if not libraries:
        sys.exit("demo: no ONNX Runtime in .venv; expected `make runtime` before")
    file, result = output(EXAMPLE, ORT_DYLIB_PATH=str(libraries[0].absolute())).strip().split(": ", 1)
    rows.append(("an ONNX model in your Rust program", result, file))

    stage = r"^(.+): (\d+) values, largest error (\S+), bound (\S+)$"
    stages = re.findall(stage, output(GOLDENS), re.MULTILINE)
    values = sum(int(count) for _, count, _, _ in stages)
    share, name = max((float(error) / float(bound), name) for name, _, error, bound in stages)
    result = f"{len(stages)} stages, {values} values, errors of at most {share:.0%} of the bound ({name})"
    rows.append(("proof that both languages agree", result, "parity/goldens"))

    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    print()
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    print("\nout/compare: truth, result, difference; out/depth: near is bright.")


if __name__ == "__main__":
    main()
