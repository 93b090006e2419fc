"""Measure the example scene and write the numbers and the picture of README.md: `make readme`.

Every figure comes from `liveview render --json` and `python -m liveview_ref.parity`, run here, now.
"""

import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from cards import fill
from liveview_ref.evaluate import machine
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
BINARY = ROOT / "target" / "release" / "liveview"
SCENE = "tests/scenes/workshop"
LAYERS = (["--guided", "2"], ["--guided", "4"], ["--guided", "8"], ["--select", "16"], ["--planes", "64"])
RUNS = 3


def render(*options: str) -> dict:
    command = [BINARY, "--json", "render", SCENE, "--target", "target_0,target_1", *options]
    return json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout)


def seconds(report: dict) -> list[float]:
    """Time per picture, without reading photos."""
    return [sum(t for stage, t in target["seconds"].items() if stage != "photos") for target in report["targets"]]


def numbers() -> tuple[str, str]:
    """A line, and the table."""
    rows = {(views, tuple(layers)): [] for views in ("4", "5") for layers in LAYERS}
    with tempfile.TemporaryDirectory() as out:
        for _ in range(RUNS):  # interleaved: a slow minute of the machine falls on all
            for (views, layers), reports in rows.items():
                reports.append(render("--views", views, *layers, "-o", out))
    first = rows["4", tuple(LAYERS[0])][0]
    size = "{width}x{height}".format(**first["targets"][0])
    lines = [
        f"Example scene, {size}, mean of its two held-out photos (16-pixel border left out), "
        f"{first['engine']['threads']} threads, {Path(first['engine']['library']).name}, {machine()} "
        f"({'AVX-512' if 'avx512f' in Path('/proc/cpuinfo').read_text() else 'no AVX-512'}); "
        f"median time per picture of {RUNS} interleaved runs, with their range.",
        "",
        "| views | layers | PSNR dB | SSIM | seconds per picture | of it network |",
        "|---|---|---|---|---|---|",
    ]
    for (views, layers), reports in rows.items():
        times = [statistics.mean(seconds(r)) for r in reports]
        network = statistics.median(statistics.mean(t["seconds"]["network"] for t in r["targets"]) for r in reports)
        mean, median = reports[0]["mean"], statistics.median(times)
        lines.append(
            f"| {views} | {' '.join(layers).strip('-')} | {mean['psnr']:.2f} | {mean['ssim']:.4f} | "
            f"{median:.2f} ({min(times):.2f}-{max(times):.2f}) | {100 * network / median:.0f} % |"
        )
    best = rows["4", ("--guided", "4")]
    taken = statistics.median(statistics.mean(seconds(r)) for r in best)
    dense = rows["4", tuple(LAYERS[-1])]
    ratio = statistics.median(statistics.mean(seconds(r)) for r in dense) / taken
    headline = (
        f"Four guided layers at {size}: {taken:.2f} s on {first['engine']['threads']} CPU threads, {ratio:.0f} times "
        f"faster than 64 planes, {best[0]['mean']['psnr']:.1f} dB against their {dense[0]['mean']['psnr']:.1f}."
    )
    return headline, "\n".join(lines)


def parity() -> str:
    command = [sys.executable, "-m", "liveview_ref.parity", f"../{SCENE}", "--target", "target_0", "--guided", "4"]
    return subprocess.run(command, cwd=ROOT / "python", check=True, capture_output=True, text=True).stdout.strip()


def picture() -> None:
    """models/workshop_v4.jpg: truth, result and difference of target_0."""
    with tempfile.TemporaryDirectory() as out:
        compared = Path(out) / "compared"
        options = ["--target", "target_0,target_1", "-o", out, "--compare", compared]
        subprocess.run([BINARY, "render", SCENE, *options], cwd=ROOT, check=True, capture_output=True)
        Image.open(compared / "target_0.png").save(ROOT / "models" / "workshop_v4.jpg", quality=90)


def main() -> None:
    readme = ROOT / "README.md"
    headline, table = numbers()
    fill(readme, {"headline": headline, "numbers": f"\n\n{table}\n\n", "parity": f"\n\n{parity()}\n\n"})
    picture()


if __name__ == "__main__":
    main()
