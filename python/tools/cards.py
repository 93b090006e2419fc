"""Write the tables of models/README.md and the training curves, from the records and scores in
models/: `make models STEP=cards`."""

import json
from statistics import fmean

from liveview_ref.checkpoint import records
from liveview_ref.evaluation.chart import Panel, chart
from liveview_ref.paths import MODELS

from .marked_text import fill

METHODS = (
    "surface:1", "surface:1, no network", "surface:3, no network", "guided:2", "guided:4", "select:16/64", "planes:64",
    "sweep, guided:4", "sweep, planes:64", "DIS flow", "best single plane", "nearest view",
)  # fmt: skip


def kinds_of(row: dict) -> list[str]:
    """What has a PSNR in a line of the validation history."""
    others = "step", "seconds"
    return [kind for kind in row if kind not in others and not kind.endswith("SSIM") and not kind.startswith("gain")]


def trained(models: dict[str, dict]) -> str:
    """The trainings of each model, by V and the rest of its file's name, one after another."""
    lines = ["| V | steps | minutes | last validation, PSNR in dB |", "|---|---|---|---|"]
    for name, state in models.items():
        runs = [*state["earlier"], (state["views"], state["step"], state["seconds"])]
        steps, minutes = (
            " + ".join(f"{x:,.0f}" for x in each) for each in zip(*((n, s / 60) for _, n, s in runs), strict=True)
        )
        last = state["history"][-1]
        kinds = ", ".join(f"{kind}: {last[kind]:.2f}" for kind in kinds_of(last) if not kind.startswith("dev/"))
        lines.append(f"| {name} | {steps} | {minutes} | {kinds} |")
    return "\n".join(lines)


def scores(report: dict) -> str:
    """Means over scenes, and the PSNR of each."""
    scenes = {name: scene["mean"] for name, scene in report["scenes"].items()}
    lines = ["| layers | mean: PSNR dB / SSIM / LPIPS | " + " | ".join(scenes) + " |", "|---" * (len(scenes) + 2) + "|"]
    for method in (method for method in METHODS if method in report["mean"]):
        cells = [shown(report["mean"][method]), *(f"{scene[method]['psnr']:.2f}" for scene in scenes.values())]
        lines.append(f"| {method} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def shown(row: dict[str, float]) -> str:
    return f"{row['psnr']:.2f} / {row['ssim']:.3f} / {row['lpips']:.3f}"


def views(reports: dict[int, dict]) -> str:
    """Scores of surface layers by V, over the scenes with enough photos for it."""
    methods = "surface:1", "surface:1, no network", "surface:3, no network"
    lines = ["| V | scenes | " + " | ".join(methods) + " | V = 4 on these, surface:1 |", "|---" * 6 + "|"]

    def mean(report: dict, scenes: list[str], method: str) -> str:
        rows = [report["scenes"][scene]["mean"][method] for scene in scenes]
        return shown({key: fmean(row[key] for row in rows) for key in rows[0]})

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
