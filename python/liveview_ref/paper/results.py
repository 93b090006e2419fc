"""What the report is made of: the JSON files in models/paper."""

import json
from dataclasses import dataclass, field
from pathlib import Path

TITLES = {
    "liveview": "LiveView",
    "liveview_from_agreement": "LiveView, from other initial weights",
    "liveview_competing": "LiveView, competing, from the weights of liveview_v4_planes",
    "input_centred": "LiveView's network, input-centred",
    "stereo_magnification": "Stereo Magnification",
    "local_light_field": "Local Light Field (Local LF)",
    "local_light_field_at_target": "Local LF, target-centred",
    "light_field_fusion": "Light Field Fusion (LLFF)",
    "soft3d": "Soft3D",
    "deepview": "DeepView, small",
    "program": "LiveView, this program",
}
METRICS = "psnr", "ssim", "lpips"
COMPETING = ", competing"  # after the name of layers


def title(name: str) -> str:
    return TITLES.get(name, name.replace("_", " "))


@dataclass
class Results:
    """Everything that was measured, and what the paper tells; all but the last may lack anything."""

    published: dict
    scores: dict[tuple[str, str, int], dict] = field(default_factory=dict)  # by data, method and views
    histories: dict[str, list[dict]] = field(default_factory=dict)  # by file name
    cost: dict = field(default_factory=dict)
    departures: dict = field(default_factory=dict)

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
    for path in sorted((folder / "scores").glob("*.json")):
        report = read(path)
        if report.get("mean"):
            found.scores[report["data"], report["name"], report["views"]] = report
    found.histories = {path.stem: read(path) for path in sorted((folder / "history").glob("*.json"))}
    for name in ("cost", "departures"):
        if (folder / f"{name}.json").exists():
            setattr(found, name, read(folder / f"{name}.json"))
    return found


def read(path: Path):
    try:
        return json.loads(path.read_text())
    except ValueError as error:
        raise ValueError(f"{path}: {error}; expected JSON") from error
