"""Time and memory of the competitors, added to a report of `liveview sweep`.

    python -m liveview_ref.competitors REPORT/sweep.json --model models/liveview_v4.onnx

They render the report's first target, of the same photos, on its most planes, each in a process of
its own. Their rows in sweep.json have "reference": true, and sweep.md gets a table of them. The
weights are those of a checkpoint beside the model (.pt) if there is one.
"""

import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from ..rig_arrays import Arrays
from . import pipelines
from .pipelines import Job

HEADING = "\nPython implementations, with the model for any layers, the paper's composite, no depth of the photos:\n\n"


def rig_of(report: dict) -> Arrays:
    """The first target of a report, the photos that it is rendered from, and its most planes."""
    from ..extension import liveview  # not in the processes that are measured

    scene = liveview.Scene(report["scene"])
    stems = [Path(name).stem for name in scene.names]
    held_out = [stems.index(Path(name).stem) for name in ",".join(report["targets"]).split(",")]
    free = [view for view in range(len(stems)) if view not in held_out]
    target, cameras = scene.cameras[held_out[0]], [scene.cameras[view] for view in free]
    views = [free[i] for i in liveview.choose_views(cameras, target, report["views"])]
    ranges = [scene.depth_ranges[view] for view in views]
    planes = max(row["count"] for row in report["rows"] if row["layers"].startswith("planes:"))
    near, far = min(near for near, _ in ranges), max(far for _, far in ranges)
    data = {f"view{i}.image": scene.photo(view) for i, view in enumerate(views)}
    posed = {"target": target, **{f"view{i}": scene.cameras[view] for i, view in enumerate(views)}}
    for name, camera in posed.items():
        data |= {f"{name}.{part}": getattr(camera, part) for part in ("k", "rotation", "translation")}
    size = np.array([target.width, target.height])
    return data | {"target.size": size, "disparities": liveview.uniform_disparities(near, far, planes)}


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report", type=Path)
    parser.add_argument("--model", type=Path, required=True)
    args = parser.parse_args(arguments)
    report = json.loads(args.report.read_text())
    own = [row for row in report["rows"] if not row.get("reference")]
    # Idle threads must sleep; read when a process loads torch.
    os.environ |= {"OMP_NUM_THREADS": str(report["threads"]), "OMP_WAIT_POLICY": "passive"}
    weights, data = args.model.with_suffix(".pt"), rig_of(report)
    job = (data, args.model, weights if weights.is_file() else None)
    rows = []
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as processes:
        for name in pipelines.NAMES:
            one = Job(*job, name, report["threads"], report["batch"])
            rows.append(processes.submit(pipelines.measured, one, len(own[0]["seconds"]["all"])).result())
    args.report.write_text(json.dumps(report | {"rows": own + rows}, indent=2) + "\n")
    table = "| layers | engine | seconds (range) | MB |\n|---|---|---|---|\n"
    for row in rows:
        times, memory = row["seconds"], row["peak_memory_bytes"] / 1e6
        range_ = f"{times['median']:.3f} ({times['min']:.3f}–{times['max']:.3f})"
        table += f"| {row['layers']} | {row['engine']} | {range_} | {memory:.0f} |\n"
    text = args.report.with_suffix(".md")
    text.write_text(text.read_text().split(HEADING)[0] + HEADING + table)


if __name__ == "__main__":
    main()
