"""The results that the report is written from: the JSON files in models/paper."""

from dataclasses import dataclass, field
from pathlib import Path

from ..files import read
from ..measure.means import mean

TITLES = {
    "liveview": "LiveView",
    "liveview_from_agreement": "LiveView, initialised as a plane sweep",
    "liveview_competing": "LiveView, initialised from liveview_v4_planes",
    "liveview_surface": "LiveView, this program, surface layers",
    "liveview_no_network": "LiveView, this program, surface layers, no network",
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
OWN_VARIANTS = "input_centred", "local_light_field_at_target"  # this project's variants, not published methods
# The paper's ablation: where the planes are, and whether a network sees them one by one or all at
# once.
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
PRETRAINED = ("liveview_competing",)  # trained on other scenes before: not compared with the other methods
METRICS = "psnr", "ssim", "lpips"
LONGER = "longer"  # the folder of the results after longer training


def ablation_alone(method: str, views: int) -> bool:
    """Whether it was trained only for the figures of ablations, not for the tables."""
    return method in ON_FEWER or (views != ON_FEWER_VIEWS and method in ABLATION.values() and method != "liveview")


def title(name: str) -> str:
    return TITLES.get(name, name.replace("_", " "))


def counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


@dataclass
class Results:
    """All measurements, and the paper's figures (`published`); any measurement may be missing."""

    published: dict
    scores: dict[tuple[str, str, int], dict] = field(default_factory=dict)  # by data, method and views
    trained: dict[str, dict] = field(default_factory=dict)  # by the key of the entry
    cost: dict = field(default_factory=dict)
    departures: dict = field(default_factory=dict)
    left_out: dict[str, dict[str, list[str]]] = field(default_factory=dict)  # by data and entry: see `restrict`
    longer: "Results | None" = None  # the same methods, trained for more samples

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
    """The results in models/paper, and in its folder `longer`. ValueError names a file that is not
    valid JSON."""
    found = measured(folder, read(folder / "published.json"))
    if (folder / LONGER).is_dir():
        found.longer = measured(folder / LONGER, found.published)
    return found


def measured(folder: Path, published: dict) -> Results:
    """The results in one folder."""
    found = Results(published)
    for path in sorted(folder.glob("scores_*.json")):
        reports = read(path)
        data = path.stem.removeprefix("scores_")
        found.left_out[data] = restrict(reports)
        found.scores |= {(data, r["name"], r["views"]): r for r in reports.values() if r["targets"]}
    for name, file in {"trained": "training", "cost": "cost", "departures": "departures"}.items():
        if (folder / f"{file}.json").exists():
            setattr(found, name, read(folder / f"{file}.json"))
    return found


def restrict(reports: dict[str, dict]) -> dict[str, list[str]]:
    """Reduce the reports of one data set, by entry, to the targets that all of them have, with
    means over these alone, because means over different targets cannot be compared. Returns the
    targets that each entry lost, as scene/target. An entry that shares no target with the larger
    ones loses all its targets, without affecting the others."""

    def names(report: dict) -> list[str]:
        return [f"{target['scene']}/{target['target']}" for target in report["targets"]]

    shared: set[str] = set()
    for report in sorted(reports.values(), key=lambda report: -len(report["targets"])):
        own = set(names(report))
        shared = (own & shared) or shared or own
    lost = {}
    for key, report in reports.items():
        own = list(zip(names(report), report["targets"], strict=True))
        lost[key] = [name for name, _ in own if name not in shared]
        report["targets"] = [target for name, target in own if name in shared]
        report["mean"] = mean(report["targets"]) if report["targets"] else {}
    return lost
