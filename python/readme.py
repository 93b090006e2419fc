"""Write the numbers and the picture of README.md: `make readme`.

The numbers come from what `liveview sweep` measured (models/report, `make report`), the parity table from a run of
`python -m liveview_ref.parity` and the picture from `liveview render`, here and now.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from cards import fill
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
BINARY = ROOT / "target" / "release" / "liveview"
REPORT = ROOT / "models" / "report"
SCENE = "tests/scenes/workshop"
SHOWN = "guided 1", "guided 2", "guided 4", "guided 8", "kmeans 16", "select 16 of 64 planes", "planes 16", "planes 64"


def numbers() -> tuple[str, str]:
    """A line, and the table."""
    reports = [json.loads((REPORT / f"v{views}" / "sweep.json").read_text()) for views in (4, 5)]
    first = reports[0]
    size = "{width}x{height}".format(**first["rows"][0])
    flags = Path("/proc/cpuinfo").read_text()
    runs = len(first["rows"][0]["seconds"]["all"])
    lines = [
        f"Example scene, {size}, PSNR and SSIM the mean of its two held-out photos (16-pixel border left out), "
        f"{first['threads']} threads of {first['cpu']} ({'AVX-512' if 'avx512f' in flags else 'no AVX-512'}), batch "
        f"{first['batch']}; median time per picture of {runs} interleaved runs, with their range."
        + (" **The machine was noisy.**" if any(report["noisy"] for report in reports) else ""),
        "",
        "| views | layers | by | PSNR dB | SSIM | seconds per picture | times faster | MB |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for report in reports:
        own = [row for row in report["rows"] if not row["reference"]]
        dense = max((r for r in own if r["layers"].startswith("planes")), key=lambda r: r["count"])["seconds"]["median"]
        for row in report["rows"]:
            if row["layers"] not in SHOWN:
                continue
            seconds = row["seconds"]
            lines.append(
                f"| {report['views']} | {row['layers']} | {row['engine']} | {row['psnr']:.2f} | {row['ssim']:.4f} | "
                f"{seconds['median']:.2f} ({seconds['min']:.2f}-{seconds['max']:.2f}) | "
                f"{dense / seconds['median']:.1f} | {row['peak_memory_bytes'] / 1e6:.0f} |"
            )
    return headline(first, size), "\n".join(lines)


def headline(report: dict, size: str) -> str:
    def find(layers: str, engine: str) -> dict | None:
        rows = (r for r in report["rows"] if (r["layers"], r["engine"]) == (layers, engine))
        return next(rows, None)

    few, dense = find("guided 2", "cpu, f32"), find("planes 64", "cpu, f32")
    fastest = min((r for r in report["rows"] if r["layers"] == "guided 2"), key=lambda r: r["seconds"]["median"])
    taken, whole = few["seconds"]["median"], dense["seconds"]["median"]
    return (
        f"Two guided layers at {size}: {taken:.2f} s on {report['threads']} CPU threads, {whole / taken:.0f} times "
        f"faster than 64 planes, {few['psnr']:.1f} dB against their {dense['psnr']:.1f}; {fastest['seconds']['median']:.2f} s "
        f"with {fastest['engine']}."
    )


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
