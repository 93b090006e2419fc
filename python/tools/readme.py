"""Write the figures and pictures of README.md and docs/: `make report STEP=readme`.

Figures are those that `liveview sweep` measured (models/report) and the models' scores; the parity
table is computed again by `python -m liveview_ref.parity`, the pictures by `liveview render` and
`liveview video`.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from .marked_text import block, fill
from .sweep_tables import excerpt, gain_on_planes, int8_gain, machine, measured, network_gain, ways

ROOT = Path(__file__).resolve().parents[2]
BINARY = ROOT / "target" / "release" / "liveview"
DOCS = ROOT / "docs"
SCENE = "tests/scenes/workshop"
RIG = "tests/scenes/rig"


def figures() -> None:
    """The generated parts of the pages, from the reports in models/."""
    report = measured()
    fill(ROOT / "README.md", {"ways": f"\n{ways(report)}\n\n{machine(report)}", "gain": gain_on_planes()})
    fill(DOCS / "benchmarks.md", {"numbers": block(excerpt(report)), "network": block(network_gain())})
    fill(DOCS / "onnx-runtime.md", {"int8": int8_gain(report)})


def parity() -> str:
    """The table of docs/parity.md."""
    command = [sys.executable, "-m", "liveview_ref.parity", f"../{SCENE}", "--target", "target_0"]
    return subprocess.run(command, cwd=ROOT / "python", check=True, capture_output=True, text=True).stdout.strip()


def picture() -> None:
    """models/workshop_v4.jpg: truth and result of target_0."""
    with tempfile.TemporaryDirectory() as out:
        compared = Path(out) / "compared"
        options = ["--target", "target_0,target_1", "-o", out, "--compare", compared]
        subprocess.run([BINARY, "render", SCENE, *options], cwd=ROOT, check=True, capture_output=True)
        panels = Image.open(compared / "target_0.png")  # the third is their difference
        panels = panels.crop((0, 0, 2 * panels.width // 3 - 1, panels.height))
        panels.save(ROOT / "models" / "workshop_v4.jpg", quality=90)


def clip() -> None:
    """models/rig_v4.webp: truth and result of the rig's held-out camera, half size, ten
    frames per second."""
    with tempfile.TemporaryDirectory() as out:
        command = [BINARY, "video", RIG, "--camera", "target", "-o", out]
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
    figures()
    fill(DOCS / "parity.md", {"parity": block(parity())})
    picture()
    clip()


if __name__ == "__main__":
    main()
