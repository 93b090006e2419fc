"""Write the numbers and the pictures of README.md: `make readme`.

The numbers are those that `liveview sweep` measured (models/report, `make report`); the parity table is made anew by
`python -m liveview_ref.parity`, the pictures by `liveview render` and `liveview video`.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from .marked_text import fill

ROOT = Path(__file__).resolve().parents[2]
BINARY = ROOT / "target" / "release" / "liveview"
REPORT = ROOT / "models" / "report"
SCENE = "tests/scenes/workshop"
RIG = "tests/scenes/rig"
SHOWN = (
    "surface:1",
    "surface:2",
    "guided:1",
    "guided:2",
    "guided:4",
    "guided:8",
    "kmeans:16",
    "select:16/64",
    "planes:16",
    "planes:64",
)
# Without a network, and on other engines than the first.
FEW = "surface:1", "surface:2", "surface:3", "guided:1", "guided:2"


def measured() -> dict:
    """The report of V = 4."""
    return json.loads((REPORT / "v4" / "sweep.json").read_text())


def numbers() -> tuple[str, str]:
    """A line, and the table: an excerpt of V = 4."""
    report = measured()
    own = [row for row in report["rows"] if not row["reference"]]
    dense = max((row for row in own if row["layers"].startswith("planes:")), key=lambda row: row["count"])
    size = f"{dense['width']}x{dense['height']}"
    lines = [
        f"Example scene, {size}, V = {report['views']}, {report['threads']} threads of {report['cpu']}, "
        f"batch {report['batch']}; PSNR and SSIM the mean of its two held-out photos (of the references: the first), "
        "16-pixel border left out; median time per picture of "
        f"{len(dense['seconds']['all'])} interleaved runs, with their range; once: the photos' depth, "
        "or planes selected in a first pass." + (" **The machine was noisy.**" if report["noisy"] else ""),
        "",
        "| layers | by | PSNR dB | SSIM | seconds per picture | times faster | MB |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in report["rows"]:
        if row["layers"] not in (SHOWN if row["reference"] or row["engine"] == dense["engine"] else FEW):
            continue
        seconds = row["seconds"]
        once = f", once {seconds['once']:.2f}" if seconds["once"] > 0 else ""
        lines.append(
            f"| {row['layers']} | {row['engine']} | {row['psnr']:.2f} | {row['ssim']:.4f} | {seconds['median']:.2f} "
            f"({seconds['min']:.2f}-{seconds['max']:.2f}){once} | "
            f"{dense['seconds']['median'] / seconds['median']:.1f} | {row['peak_memory_bytes'] / 1e6:.0f} |"
        )
    return headline(report, size), "\n".join(lines)


def headline(report: dict, size: str) -> str:
    def find(layers: str, engine: str) -> dict | None:
        rows = (r for r in report["rows"] if (r["layers"], r["engine"]) == (layers, engine))
        return next(rows, None)

    surface, planes = find("surface:1", "cpu, f32"), find("planes:64", "cpu, f32")
    free = find("surface:3", "no network")
    with_network = (r for r in report["rows"] if r["layers"] == "surface:1" and r["engine"] != "no network")
    fastest = min(with_network, key=lambda r: r["seconds"]["median"])
    taken, whole = surface["seconds"]["median"], planes["seconds"]["median"]
    return (
        f"One layer along the surface at {size}: {surface['psnr']:.1f} dB, {taken:.2f} s a picture on "
        f"{report['threads']} CPU threads once the photos' depth is known ({surface['seconds']['once']:.2f} s for it), "
        f"{fastest['seconds']['median']:.2f} s with {fastest['engine']}; three without a network: "
        f"{free['psnr']:.1f} dB, {free['seconds']['median']:.2f} s; 64 planes, {planes['psnr']:.1f} dB, take "
        f"{whole / taken:.0f} times as long as one layer."
    )


def int8() -> str:
    """How many times as fast int8 is as f32 on the CPU, on the layers that gain most."""
    seconds = {}
    for row in measured()["rows"]:
        seconds.setdefault(row["engine"], {})[row["layers"]] = row["seconds"]["median"]
    whole = seconds["cpu, f32"]
    cpu, openvino = (
        max(whole[layers] / taken for layers, taken in seconds[f"{engine}, int8"].items())
        for engine in ("cpu", "openvino")
    )
    return f"{cpu:.1f} times as fast ({openvino:.1f} times with OpenVINO)"


def parity() -> str:
    command = [sys.executable, "-m", "liveview_ref.parity", f"../{SCENE}", "--target", "target_0"]
    command += ["--layers", "guided:4"]
    return subprocess.run(command, cwd=ROOT / "python", check=True, capture_output=True, text=True).stdout.strip()


def picture() -> None:
    """models/workshop_v4.jpg: truth, result and difference of target_0."""
    with tempfile.TemporaryDirectory() as out:
        compared = Path(out) / "compared"
        options = ["--target", "target_0,target_1", "-o", out, "--compare", compared]
        subprocess.run([BINARY, "render", SCENE, *options], cwd=ROOT, check=True, capture_output=True)
        Image.open(compared / "target_0.png").save(ROOT / "models" / "workshop_v4.jpg", quality=90)


def clip() -> None:
    """models/rig_v4.webp: truth and result of the rig's held-out camera, half size, ten frames per second."""
    with tempfile.TemporaryDirectory() as out:
        command = [BINARY, "video", RIG, "--camera", "target", "--layers", "surface:1", "-o", out]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
        frames = []
        for truth, made in zip(sorted((ROOT / RIG / "target").glob("*.jpg")), sorted(Path(out).iterdir()), strict=True):
            halves = [Image.open(path).convert("RGB").reduce(2) for path in (truth, made)]
            width, height = halves[0].size
            frame = Image.new("RGB", (2 * width + 4, height), "white")
            for index, half in enumerate(halves):
                frame.paste(half, (index * (width + 4), 0))
            frames.append(frame)
    frames[0].save(
        ROOT / "models" / "rig_v4.webp",
        save_all=True,
        append_images=frames[1:],
        duration=100,
        loop=0,
        quality=80,
        method=6,
    )


def main() -> None:
    readme = ROOT / "README.md"
    headline, table = numbers()
    parts = {"headline": headline, "numbers": f"\n\n{table}\n\n", "int8": int8(), "parity": f"\n\n{parity()}\n\n"}
    fill(readme, parts)
    picture()
    clip()


if __name__ == "__main__":
    main()
