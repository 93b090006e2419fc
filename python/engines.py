"""Measure the engines and precisions that are installed here, and write the table of README.md: `make engines`.

Every figure comes from `liveview render --json`, interleaved: a slow minute of the machine falls on all of them.
"""

import json
import statistics
import subprocess
import tempfile
from pathlib import Path

from cards import fill
from liveview_ref.evaluate import machine

ROOT = Path(__file__).resolve().parents[1]
BINARY = ROOT / "target" / "release" / "liveview"
RUNS = 9
THREADS = "2"


def render(out: str, views: str, engine: str, precision: str) -> dict:
    options = ["--views", views, "--engine", engine, "--precision", precision, "--threads", THREADS, "-o", out]
    command = [BINARY, "--json", "render", "tests/scenes/workshop", "--target", "target_0,target_1", "--guided", "4"]
    done = subprocess.run([*command, *options], cwd=ROOT, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def main() -> None:
    engines = ["cpu"] + ["openvino"] * (ROOT / ".venv-openvino").exists()
    rows = {(v, e, p): [] for v in ("4", "5") for e in engines for p in ("f32", "int8")}
    with tempfile.TemporaryDirectory() as out:
        for _ in range(RUNS):
            for row, reports in rows.items():
                reports.append(render(out, *row))
    lines = ["| views | engine | precision | ms per layer | of cpu f32 | PSNR dB |", "|---|---|---|---|---|---|"]
    # The last picture: the first one of a run pays for what an engine prepares.
    taken = {row: [1000 * r["targets"][-1]["seconds"]["network"] / 4 for r in reports] for row, reports in rows.items()}
    for (views, engine, precision), reports in rows.items():
        times, base = taken[views, engine, precision], taken[views, "cpu", "f32"]
        share = statistics.median(a / b for a, b in zip(times, base, strict=True))
        middle, least, most = statistics.median(times), min(times), max(times)
        lines.append(
            f"| {views} | {engine} | {precision} | {middle:.0f} ({least:.0f}-{most:.0f}) | "
            f"{share:.2f} | {reports[0]['mean']['psnr']:.2f} |"
        )
    flags = (Path("/proc/cpuinfo").read_text().split("flags", 1)[1:] or [""])[0].split("\n", 1)[0]
    has = [f"{'' if flag in flags else 'no '}{name}" for flag, name in [("avx512f", "AVX-512"), ("vnni", "VNNI")]]
    told = (
        f"Example scene, 504x352, guided 4, {THREADS} threads of {machine()} ({', '.join(has)}); median of {RUNS} "
        "interleaved runs on a shared machine:\ntrust the ratios."
    )
    fill(ROOT / "README.md", {"engines": "\n\n" + "\n".join([told, "", *lines]) + "\n\n"})


if __name__ == "__main__":
    main()
