"""Write the tables of models/README.md and the training curves, from the records and scores in
models/: `make models STEP=cards`."""

import json
from pathlib import Path
from statistics import fmean

from liveview_ref.checkpoint import records, training_of
from liveview_ref.evaluation.chart import Panel, chart
from liveview_ref.paths import MODELS

from .marked_text import fill

METHODS = (
    "surface:2", "surface:1", "surface:1, no network", "surface:3, no network", "guided:2", "guided:4", "guided:8",
    "select:16/64", "planes:64", "sweep, guided:4", "sweep, planes:64", "DIS flow", "best single plane", "nearest view",
)  # fmt: skip


def kinds_of(row: dict) -> list[str]:
    """What has a PSNR in a line of the validation history."""
    others = "step", "seconds"
    return [kind for kind in row if kind not in others and not kind.endswith("SSIM") and not kind.startswith("gain")]


def trained(models: dict[str, dict]) -> str:
    """The training of each model, by V and the rest of its file's name."""
    lines = ["| V | training | last validation, PSNR in dB | of |", "|---|---|---|---|"]
    for name, state in models.items():
        last = {kind: state["history"][-1][kind] for kind in kinds_of(state["history"][-1])}
        scenes = ", ".join(f"{Path(s['path']).name} at {s['width']}" for s in state["config"]["validation"])
        row = (name, training_of(state), ", ".join(f"{kind}: {value:.2f}" for kind, value in last.items()), scenes)
        lines.append("| " + " | ".join(map(str, row)) + " |")
    return "\n".join(lines)


def scores(report: dict) -> str:
    scenes = {**report["scenes"], "mean over scenes": {"mean": report["mean"]}}
    lines = ["| PSNR dB / SSIM / LPIPS | " + " | ".join(scenes) + " |", "|---" * (len(scenes) + 1) + "|"]
    for method in (method for method in METHODS if method in report["mean"]):
        rows = [scene["mean"][method] for scene in scenes.values()]
        cells = [f"{row['psnr']:.2f} / {row['ssim']:.3f} / {row['lpips']:.3f}" for row in rows]
        lines.append(f"| {method} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def views(reports: dict[int, dict]) -> str:
    """Scores of surface layers by V, over the scenes with enough photos for it."""
    methods = "surface:1", "surface:2", "surface:1, no network", "surface:3, no network"
    head = ["V", "scenes", *methods, "V = 4 on the same scenes, surface:1"]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]

    def mean(report: dict, scenes: list[str], method: str) -> str:
        rows = [report["scenes"][scene]["mean"][method] for scene in scenes]
        psnr, ssim, lpips = (fmean(row[key] for row in rows) for key in ("psnr", "ssim", "lpips"))
        return f"{psnr:.2f} / {ssim:.4f} / {lpips:.4f}"

    for count, report in sorted(reports.items()):
        scenes = [scene for scene in report["scenes"] if scene in reports[4]["scenes"]]
        cells = [mean(report, scenes, method) for method in methods] + [mean(reports[4], scenes, methods[0])]
        lines.append(f"| {count} | {len(scenes)} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def curves(name: str, state: dict) -> Panel:
    """Validation against steps; kinds of layers may be added during a training."""
    kinds = dict.fromkeys(kind for row in state["history"] for kind in kinds_of(row))
    points = {kind: [(row["step"], row[kind]) for row in state["history"] if kind in row] for kind in kinds}
    return Panel(f"V = {name}: PSNR of validation, dB", "steps of the last training", points)


def main() -> None:
    states = {stem.removeprefix("liveview_v").replace("_", ", "): state for stem, state in records(MODELS).items()}
    models = {name: states[name] for name in sorted(states, key=lambda name: (states[name]["views"], name))}
    report = json.loads((MODELS / "liveview_v4_scores" / "scores.json").read_text())
    found = {path.parent.name: json.loads(path.read_text()) for path in MODELS.glob("liveview_v*_scores/scores.json")}
    by_views = {each["views"]: each for name, each in found.items() if name == f"liveview_v{each.get('views')}_scores"}
    parts = {"trained": trained(models), "scores": scores(report), "views": views(by_views)}
    fill(MODELS / "README.md", {name: f"\n\n{part}\n\n" for name, part in parts.items()})
    (MODELS / "curves.svg").write_text(chart([curves(name, state) for name, state in models.items()]))


if __name__ == "__main__":
    main()
