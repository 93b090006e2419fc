"""Write docs/paper-comparison.md: page.md with tables of the results in models/paper.

    python -m liveview_ref.paper.report.page

Ours come from the JSON files of scores, cost and departures, the paper's (in italics) from
published.json; a figure that is missing is a dash."""

import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from liveview_ref.paths import MODELS, ROOT

from ..files import put, read
from ..measure.score import mean
from ..measure.variants import COMPETING

TITLES = {
    "soft3d": "Soft3D",
    "deepview": "DeepView, small",
    "stereo_magnification": "Stereo Magnification",
    "local_light_field": "Local LF",
    "light_field_fusion": "LLFF",
    "liveview": "LiveView",
    "local_light_field_at_target": "Local LF",
    "liveview_no_network": "`surface:3`, no network",
    "liveview_surface": "`surface:2`",
    "program": "this program",
}
COMPARED = {
    4: ("soft3d", "deepview", "liveview", "liveview_no_network", "liveview_surface"),
    5: ("stereo_magnification", "local_light_field", "liveview"),
    10: ("light_field_fusion", "liveview"),
}
# The paper's ablation: planes at the target or at a photo, seen one by one (dynamic) or together.
ABLATION = "liveview", "input_centred", "local_light_field_at_target", "local_light_field"
TRAINED_ON_FEWER, FEWER_VIEWS = ("liveview", "local_light_field_at_target"), 5
DASH = "–"


@dataclass
class Scores:
    """The scores on one data set, by entry (`liveview_v4`)."""

    reports: dict[str, dict]

    def row(self, entry: str, layers: str) -> dict | None:
        """Mean scores of an entry on these layers."""
        return self.reports.get(entry, {}).get("mean", {}).get(layers)

    def whole(self, entry: str, suffix: str = "") -> dict | None:
        """The same on the planes of its training, or on the most if nothing was trained: some
        networks need that number."""
        report = self.reports.get(entry)
        if not report or not report["targets"]:
            return None
        counts = [int(name[7:]) for name in report["mean"] if re.fullmatch(r"planes:\d+", name)]
        return self.row(entry, f"planes:{report['about'].get('planes') or max(counts)}{suffix}")

    def counted(self) -> str:
        """How many targets of how many scenes the means are over."""
        targets = next((report["targets"] for report in self.reports.values() if report["targets"]), [])
        return f"{len(targets)} targets of {len({target['scene'] for target in targets})} scenes"


def load(path: Path) -> Scores:
    """Scores on the targets that all entries have, because means over different targets cannot be
    compared. An entry that shares no target with the larger ones loses all its targets."""
    reports = read(path) if path.exists() else {}
    shared: set[tuple] = set()
    for report in sorted(reports.values(), key=lambda report: -len(report["targets"])):
        own = {(target["scene"], target["target"]) for target in report["targets"]}
        shared = (own & shared) or shared or own
    for report in reports.values():
        report["targets"] = [each for each in report["targets"] if (each["scene"], each["target"]) in shared]
        report["mean"] = mean(report["targets"]) if report["targets"] else {}
    return Scores(reports)


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head, *rest = ["| " + " | ".join(row) + " |" for row in (head, *rows)]
    return "\n".join([head, "|---" * (head.count(" | ") + 1) + "|", *rest])


def cell(row: dict | None) -> str:
    """PSNR dB ± standard error, SSIM, LPIPS."""
    if row is None:
        return DASH
    return f"{row['psnr']:.2f}±{row.get('psnr_se', 0):.2f}, {row['ssim']:.3f}, {row['lpips']:.3f}"


def psnr(row: dict | None) -> str:
    return f"{row['psnr']:.2f}" if row else DASH


def quality(rig: Scores, longer: Scores, real: Scores, published: list[dict]) -> str:
    """Every method with its planes' own alpha, and LiveView with competing planes as well."""
    paper = {(row["method"], row["views"]): row for row in published}
    rows = []
    for views, methods in COMPARED.items():
        for method in methods:
            entry, theirs = f"{method}_v{views}", paper.get((method, views), {})
            for suffix in ("", COMPETING):
                found = [scores.whole(entry, suffix) for scores in (rig, longer, real)]
                if suffix and not any(found):
                    continue
                given = f"*{theirs['spaces'][0]:g}*" if theirs and not suffix else DASH
                rows.append([str(views), TITLES[method] + suffix, *map(cell, found), given])
    head = ["V", "method", "1,000 samples", "10,000 samples", "real photos", "*Spaces*"]
    return table(head, rows)


def ablation(rig: Scores) -> str:
    def both(entry: str) -> str:
        return f"{psnr(rig.row(entry, 'planes:64'))} ({psnr(rig.row(entry, 'planes:16'))})"

    head = ["V", "target, dynamic", "input, dynamic", "target, static", "input, static"]
    return table(head, ([str(views), *(both(f"{method}_v{views}") for method in ABLATION)] for views in COMPARED))


def trained_planes(rig: Scores) -> str:
    rows = []
    for method in TRAINED_ON_FEWER:
        for trained in ("16", "32", "64"):
            entry = f"{method}_on_{trained}" if trained != "64" else method
            found = [rig.row(f"{entry}_v{FEWER_VIEWS}", f"planes:{count}") for count in (16, 32, 64)]
            rows.append([TITLES[method], trained, *map(psnr, found)])
    return table(["network", "trained on", "16", "32", "64"], rows)


def selection(rig: Scores) -> str:
    layers = [f"{name}{suffix}" for suffix in ("", COMPETING) for name in ("planes:16", "select:16/64", "planes:64")]
    rows = []
    for views in COMPARED:
        found = [rig.row(f"liveview_v{views}", name) for name in layers]
        rows.append([str(views), *(f"{row['ssim']:.4f}" if row else DASH for row in found)])
    return table(["V", *(name.replace("planes:", "") for name in layers)], rows)


def cost(rows: list[dict], published: list[dict]) -> str:
    """The paper's methods and this program."""
    paper = {(row["method"], row["planes"]): row["seconds"] for row in published}
    slow = next((row["seconds"]["median"] for row in rows if name_of(row) == "light_field_fusion"), None)
    lines = []
    for row in rows:
        method, seconds, counted = name_of(row), row["seconds"]["median"], row.get("parameters")
        if method in ABLATION[1:3]:  # the same networks elsewhere
            continue
        theirs = paper.get((method, row["planes"]))
        lines.append([
            TITLES[method], str(row["views"]), str(row["planes"]), f"{seconds:.2f}",
            f"{slow / seconds:.1f}" if slow else DASH,
            thousands(row["multiply_adds_per_pixel"]) if counted else DASH, thousands(counted) if counted else DASH,
            f"{row['peak_memory'] / 2**20:,.0f}", f"*{theirs:g}*" if theirs else DASH,
        ])  # fmt: skip
    head = ["method", "V", "planes", "s", "LLFF / s", "multiply-adds", "weights", "MiB", "*s*"]
    return table(head, lines)


def name_of(row: dict) -> str:
    return row["name"].rsplit("_v", 1)[0]


def thousands(value: float) -> str:
    return f"{value / 1000:,.0f}K"


def departures(measured: dict[str, dict]) -> str:
    """The change in dB by each network, and in brackets that of the border alone where it differs
    by more than 1 dB."""

    def change(row: dict | None) -> str:
        if row is None:
            return DASH
        inside, border = row["difference"], row["border_difference"]
        return f"{inside:+.2f}" + (f" ({border:+.2f})" if abs(border - inside) > 1 else "")

    names = dict.fromkeys(name for each in measured.values() for name in each["mean"] if name != "unchanged")
    rows = [[name, *(change(each["mean"].get(name)) for each in measured.values())] for name in names]
    unchanged = ["unchanged: PSNR, dB", *(psnr(each["mean"]["unchanged"]) for each in measured.values())]
    return table(["change", *measured], [unchanged, *rows])


def write(models: Path, page: Path) -> None:
    """Write the page."""

    def optional(name: str) -> dict:
        return read(models / name) if (models / name).exists() else {}

    published = read(models / "published.json")
    rig, real = (load(models / f"scores_{data}.json") for data in ("rig", "real"))
    timed = optional("cost.json")
    parts = {
        "quality": quality(rig, load(models / "longer" / "scores_rig.json"), real, published["comparison"]),
        "rig_targets": rig.counted(),
        "real_targets": real.counted(),
        "ablation": ablation(rig),
        "trained_planes": trained_planes(rig),
        "selection": selection(rig),
        "machine": f"{timed['cpu']}, {timed['threads']} threads" if timed else DASH,
        "cost": cost(timed.get("rows", []), published["speed"]),
        "departures": departures(optional("departures.json")),
    }
    text = (Path(__file__).parent / "page.md").read_text()
    named = set(re.findall(r"\{\{(\w+)\}\}", text))
    if named != set(parts):
        raise ValueError(f"page.md: {', '.join(sorted(named ^ set(parts)))}: expected in the text and in page.py")
    for name, part in parts.items():
        text = text.replace("{{" + name + "}}", part)
    put(page, lambda path: path.write_text(text))


def main() -> int:
    try:
        write(MODELS / "paper", ROOT / "docs" / "paper-comparison.md")
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
