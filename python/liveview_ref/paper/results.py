"""What the report is made of: the JSON files in models/paper."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean, stdev

TITLES = {
    "liveview": "LiveView",
    "liveview_from_agreement": "LiveView, from other initial weights",
    "liveview_competing": "LiveView, begun from liveview_v4_planes",
    "liveview_surface": "LiveView, this program, layers along the surface",
    "liveview_no_network": "LiveView, this program, layers along the surface, no network",
    "input_centred": "LiveView's network, input-centred",
    "stereo_magnification": "Stereo Magnification",
    "local_light_field": "Local Light Field (Local LF)",
    "local_light_field_at_target": "Local LF, target-centred",
    "local_light_field_at_target_on_16": "Local LF, target-centred, trained on 16 planes",
    "local_light_field_at_target_on_32": "Local LF, target-centred, trained on 32 planes",
    "liveview_on_16": "LiveView, trained on 16 planes",
    "liveview_on_32": "LiveView, trained on 32 planes",
    "light_field_fusion": "Light Field Fusion (LLFF)",
    "soft3d": "Soft3D",
    "deepview": "DeepView, small",
    "program": "LiveView, this program",
}
OWN_VARIANTS = "input_centred", "local_light_field_at_target"  # this project's own, not methods of their own
# The paper's ablation: where the planes are, and whether a network sees them one by one or all at once.
ABLATION = {
    "target-centred, dynamic": "liveview",
    "input-centred, dynamic": "input_centred",
    "target-centred, static": "local_light_field_at_target",
    "input-centred, static": "local_light_field",
}
ABLATION_VIEWS = 4, 5, 10
DYNAMIC_STATIC = "liveview", "local_light_field_at_target"
ON_FEWER = tuple(f"{method}_on_{planes}" for method in DYNAMIC_STATIC for planes in (16, 32))  # trained on fewer planes
ON_FEWER_VIEWS = 5
BEGUN_ELSEWHERE = ("liveview_competing",)  # trained on other scenes before: no part in what is compared
METRICS = "psnr", "ssim", "lpips"
COMPETING = ", competing"  # after the name of layers


def ablation_alone(method: str, views: int) -> bool:
    """Whether it was trained for the figures of ablations alone, beside the methods that the tables compare."""
    return method in ON_FEWER or (views != ON_FEWER_VIEWS and method in ABLATION.values() and method != "liveview")


def title(name: str) -> str:
    return TITLES.get(name, name.replace("_", " "))


def counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


@dataclass
class Results:
    """Everything that was measured, and what the paper tells; all but the last may lack anything."""

    published: dict
    scores: dict[tuple[str, str, int], dict] = field(default_factory=dict)  # by data, method and views
    histories: dict[str, list[dict]] = field(default_factory=dict)  # by file name
    cost: dict = field(default_factory=dict)
    departures: dict = field(default_factory=dict)
    left_out: dict[str, dict[str, list[str]]] = field(default_factory=dict)  # by data and file: see `restrict`

    def methods(self, data: str) -> list[tuple[str, int]]:
        """(method, views) with scores on that data, fewest views first."""
        return sorted(((name, views) for d, name, views in self.scores if d == data), key=lambda row: (row[1], row[0]))

    def row(self, data: str, method: str, views: int, layers: str) -> dict | None:
        """Mean scores of a method on these layers."""
        report = self.scores.get((data, method, views))
        return report["mean"].get(layers) if report else None

    def most_planes(self, data: str, method: str, views: int) -> int:
        return max(self.plane_counts(data, method, views), default=0)

    def plane_counts(self, data: str, method: str, views: int) -> list[int]:
        report = self.scores.get((data, method, views))
        names = report["mean"] if report else ()
        return sorted(int(name[7:]) for name in names if name.startswith("planes:") and name[7:].isdecimal())


def load(folder: Path) -> Results:
    """Of models/paper. What is no JSON of its kind is a ValueError that names the file."""
    found = Results(read(folder / "published.json"))
    files: dict[str, dict[str, dict]] = {}
    for path in sorted((folder / "scores").glob("*.json")):
        report = read(path)
        files.setdefault(report["data"], {})[path.name] = report
    for data, reports in files.items():
        found.left_out[data] = restrict(reports)
        found.scores |= {(data, r["name"], r["views"]): r for r in reports.values() if r["targets"]}
    found.histories = {path.stem: read(path) for path in sorted((folder / "history").glob("*.json"))}
    for name in ("cost", "departures"):
        if (folder / f"{name}.json").exists():
            setattr(found, name, read(folder / f"{name}.json"))
    return found


def restrict(files: dict[str, dict]) -> dict[str, list[str]]:
    """Cuts the score files of one data to the targets that all of them have, with means over these alone, since means
    over different targets cannot be compared; what each file lost, as scene/target. A file without any target that the
    fuller ones share loses all of its own, and no other loses any for it."""

    def names(report: dict) -> list[str]:
        return [f"{target['scene']}/{target['target']}" for target in report["targets"]]

    shared: set[str] = set()
    for report in sorted(files.values(), key=lambda report: -len(report["targets"])):
        own = set(names(report))
        shared = (own & shared) or shared or own
    lost = {}
    for file, report in files.items():
        own = list(zip(names(report), report["targets"], strict=True))
        lost[file] = [name for name, _ in own if name not in shared]
        report["targets"] = [target for name, target in own if name in shared]
        report["mean"] = mean(report["targets"]) if report["targets"] else {}
    return lost


def mean(targets: list[dict]) -> dict[str, dict[str, float]]:
    """Of each kind of layers: the mean over scenes of the mean over their targets, and its standard error (`_se`, over
    scenes, absent for a single one)."""
    out = {}
    for layers in targets[0]["scores"]:
        by_scene: dict[str, list[dict]] = {}
        for target in targets:
            by_scene.setdefault(target["scene"], []).append(target["scores"][layers])
        row = {}
        for metric in targets[0]["scores"][layers]:
            means = [fmean(scores[metric] for scores in rows) for rows in by_scene.values()]
            row[metric] = round(fmean(means), 5)
            if len(means) > 1:
                row[f"{metric}_se"] = round(stdev(means) / len(means) ** 0.5, 5)
        out[layers] = row
    return out


def read(path: Path):
    try:
        return json.loads(path.read_text())
    except ValueError as error:
        raise ValueError(f"{path}: {error}; expected JSON") from error


def write(path: Path, report: dict | list) -> None:
    put(path, lambda temporary: temporary.write_text(json.dumps(report, indent=1) + "\n"))


def put(path: Path, save: Callable[[Path], object]) -> None:
    """A file that is never there half written."""
    temporary = path.with_suffix(".tmp")
    save(temporary)
    temporary.rename(path)
