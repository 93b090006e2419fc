"""Plot what `liveview video --measure FOLDER` wrote, over time: FOLDER/measure.svg.

Usage, in python/: python -m tools.live_plot FOLDER
"""

import json
import sys
from pathlib import Path

from liveview_ref.evaluation.chart import Panel, chart

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    lines = [json.loads(line) for line in (folder / "frames.jsonl").read_text().splitlines()]
    shown = [line for line in lines if "seconds" in line]
    names = ["waited", *shown[0]["seconds"]]
    stages = {name: [(line["frame"], 1e3 * (line | line["seconds"])[name]) for line in shown] for name in names}
    arrival = {"rendered": [(line["frame"], 1e3 * line["since_arrival"]) for line in shown]}
    ages = {"depth": [(line["frame"], line["age"]) for line in shown]}
    panels = [Panel("ms since the first photo arrived", "frame", arrival), Panel("ms of a stage", "frame", stages)]
    (folder / "measure.svg").write_text(chart([*panels, Panel("frames since a search", "frame", ages)]))
