"""Write docs/paper-comparison.md and its pictures from the results in models/paper.

    python -m liveview_ref.paper.report.page

No figure in it is typed by hand: ours come from the JSON files of scores, cost and departures, the
paper's from published.json. Missing figures are listed. --crops is the folder of crops that scoring
wrote; without it the existing figure remains."""

import argparse
import re
import sys
import tomllib
from pathlib import Path

from liveview_ref.paths import MODELS, ROOT

from ..files import put
from . import figures, tables
from .results import Results, counted, load, title
from .verdicts import ablation_verdicts, longer_verdicts, verdicts

HERE = Path(__file__).parent
LEFT_OUT = """
Scored (scene/target), but left out of the means, because other methods lack them:
"""


def departures(results: Results, listed: list[dict]) -> str:
    """The table of departures, with the change in dB if one is undone or introduced, by network."""
    rows = []
    for each in listed:
        rows.append([each["paper"], each["here"], each["why"], "; ".join(changes(results, each)) or "not measured"])
    return tables.table(["the paper", "here", "why", "change, dB"], rows)


def changes(results: Results, each: dict) -> list[str]:
    """The known effects of a departure."""
    found = [each[kind] for kind in ("retraining", "elsewhere") if kind in each]
    if "retraining" in each:
        found[0] = f"needs another training: {found[0]}"
    for direction in ("undone", "introduced"):
        for name in each.get(direction, []):
            values = [
                f"{network}: {in_decibels(report['mean'][name], each.get('border', False))}"
                for network, report in results.departures.items()
                if name in report["mean"]
            ]
            found.append(f"{direction} ({name}): {', '.join(values) or 'not measured yet'}")
    if "compared" in each:
        first, second = (tables.best_row(results, "rig", *row, "") for row in each["compared"])
        names = " against ".join(title(row[0]) for row in each["compared"])
        change = f"{first['psnr'] - second['psnr']:+.2f}" if first and second else "not scored yet"
        found.append(f"{names}: {change}")
    return found


def in_decibels(row: dict, border: bool) -> str:
    """The change, and that of the border alone if the departure acts there."""
    at_border = f"{row['border_difference']:+.2f}" if "border_difference" in row else "not measured yet"
    return f"{row['difference']:+.2f}" + (f" (border: {at_border})" if border else "")


def departure_networks(results: Results) -> str:
    return "; ".join(
        f"`{network}` ({report['mean']['unchanged']['psnr']:.2f} dB unchanged)" if not network.count(" ") else
        f"{network} ({report['mean']['unchanged']['psnr']:.2f} dB)"
        for network, report in results.departures.items()
    ) or "none measured yet"  # fmt: skip


def scored(results: Results) -> str:
    """The number of scenes and targets of the scores, and the targets that are in no mean."""
    parts, left_out = [], {}
    for data, lost in results.left_out.items():
        reports = [report for (d, _, _), report in results.scores.items() if d == data]
        targets = next((report["targets"] for report in reports), [])
        scenes = len({target["scene"] for target in targets})
        trained = " and ".join(sorted({report["key"]["trained_on"] for report in reports}))
        count = f"{counted(len(targets), 'target')} of {counted(scenes, 'scene')}"
        parts.append(f"{tables.DATA[data]}: {count}, trained on {trained}")
        for key, names in lost.items():
            if names:
                name, views = key.rsplit("_v", 1)
                left_out.setdefault(", ".join(names), []).append(f"{title(name)} at V = {views}")
    lines = [f"- {', '.join(keys)}: {names}" for names, keys in left_out.items()]
    found = [f"Every row of a column is over the same targets. {'; '.join(parts)}.", *([LEFT_OUT] if lines else [])]
    return "\n".join([*found, *lines]) if parts else "Nothing is scored yet."


def steps(results: Results) -> str:
    """Steps, samples and processor time of each training."""
    rows = []
    for (data, method, views), report in sorted(results.scores.items(), key=lambda item: (item[0][2], item[0][1])):
        about = report["about"]
        if data == "rig" and about.get("step"):
            cells = [f"{about['step']:,}", f"{about['samples']:,}", f"{about['core_seconds'] / 3600:.2f}"]
            rows.append([str(views), title(method), *cells])
    return tables.table(["V", "method", "steps", "samples", "core hours"], rows) if rows else ""


def opx(results: Results) -> str:
    """The unit of the paper's OPX, inferred from our count for the same table."""
    own = next((r for r in tables.cost_rows(results) if r["method"] == "liveview" and r["planes"] == 64), None)
    published = next(r for r in results.published["speed"] if r["method"] == "liveview" and r["planes"] == 64)
    if own is None:
        return "ours are not counted yet"
    ratios = {n: own["multiply_adds_per_pixel"] * n / published["operations_per_pixel"] for n in (1, 2)}
    kind = "multiply-adds" if abs(ratios[1] - 1) < abs(ratios[2] - 1) else "FLOPs"
    return f"LiveView's own table has {ratios[1]:.2f} times as many multiply-adds: they count {kind}"


def selection_claim(results: Results) -> str:
    claim = results.published["selection"]
    return f"{claim['ssim']} on {claim['planes']} selected planes, {claim['of_ssim']} on {claim['of_planes']}"


def machine(results: Results) -> str:
    cost = results.cost
    if not cost:
        return "Not measured yet."
    width, height = cost["size"]
    return f"{cost['cpu']}, {cost['threads']} threads, {width} × {height} pixels, {cost['rounds']} rounds."


def picture(out: Path, docs: Path, content, save) -> str:
    """Write a picture, unless there is none."""
    if content is None:
        return "Not measured yet."
    put(out, save)
    return link(out, docs)


def link(out: Path, docs: Path) -> str:
    return f"![{out.stem.replace('_', ' ')}](../{out.relative_to(docs.parent).as_posix()})"


def crops_of(out: Path, docs: Path, sheet) -> str:
    """The figure of crops: drawn again if there are crops, else the one in models/paper."""
    if sheet is None and out.exists():
        return link(out, docs)
    return picture(out, docs, sheet, lambda path: sheet.save(path, "webp", quality=85))


def write(models: Path, page: Path, crops: Path | None = None) -> None:
    """Write the page, and its pictures to models/paper."""
    results = load(models)
    listed = tomllib.loads((HERE / "departures.toml").read_text())["departure"]
    charts = {
        name: picture(models / f"{name}.svg", page.parent, svg, lambda path, svg=svg: path.write_text(svg))
        for name, svg in {
            "ablation": figures.ablation(results),
            "trained_planes": figures.trained_planes(results),
            "selection": figures.selection(results),
            "training": figures.training(results),
            "longer": figures.training(results.longer) if results.longer else None,
        }.items()
    }
    sheet = figures.crops(crops) if crops else None
    targets = sorted(len(report["targets"]) for report in results.departures.values())
    counts = " to ".join(map(str, sorted({*targets[:1], *targets[-1:]})))
    parts = charts | {
        "comparison": tables.comparison(results),
        "verdicts": verdicts(results),
        "ablation_verdicts": ablation_verdicts(results),
        "longer_table": tables.longer(results),
        "longer_verdicts": longer_verdicts(results),
        "scored": scored(results),
        "missing": tables.missing(results),
        "crops": crops_of(models / "crops.webp", page.parent, sheet),
        "selection_claim": selection_claim(results),
        "planes_table": tables.planes_table(results),
        "machine": machine(results),
        "opx": opx(results),
        "speed": tables.speed(results),
        "speed_up": tables.speed_up(results),
        "steps": steps(results),
        "departures": departures(results, listed),
        "departure_networks": departure_networks(results),
        "departure_targets": f"quarters of {counts} of the rig's targets" if targets else "no target yet",
    }
    text = (HERE / "page.md").read_text()
    named = set(re.findall(r"\{\{(\w+)\}\}", text))
    if named != set(parts):
        raise ValueError(f"page.md: {', '.join(sorted(named ^ set(parts)))}: expected in the text and in page.py")
    for name, part in parts.items():
        text = text.replace("{{" + name + "}}", part)
    put(page, lambda path: path.write_text(text))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--crops", type=Path, help="folder of the crops of scoring (RUNS/crops)")
    args = parser.parse_args()
    try:
        write(MODELS / "paper", ROOT / "docs" / "paper-comparison.md", args.crops)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
