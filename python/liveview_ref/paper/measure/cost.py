"""The cost of a picture by each method, measured on one machine in interleaved runs: time of each
stage, multiply-adds, parameters, memory.

    python -m liveview_ref.paper.measure.cost --out ../models/paper/cost.json --rounds 5

Each method runs in its own process (cost_worker.py), so that its peak memory can be measured. The
program itself (`liveview render`, ONNX Runtime) renders the same photos, in a separate row."""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from statistics import median

import torch

from liveview_ref.data.scene import write_scene
from liveview_ref.evaluation.evaluate import machine, versions
from liveview_ref.paths import BINARY, MODELS

from ..data import rig
from ..files import write
from ..methods.registry import ENTRIES, Entry
from . import cost_worker
from .cost_worker import scene

VIEWS = 5  # of the paper's methods except LLFF
FEWER_PLANES = 32, 16  # LiveView is timed on these as well, as in the paper's table
PROGRAM = "program"


class Worker:
    """A method in a process of its own."""

    def __init__(self, *args):
        self.process = ProcessPoolExecutor(1, get_context("spawn"), cost_worker.start, args)

    def run(self) -> dict:
        return self.process.submit(cost_worker.run).result()


class Program:
    """`liveview render` of a scene on disk; its stages are those in its report."""

    def __init__(self, binary: Path, folder: Path, planes: int, threads: int, views: int):
        photos, target = scene(views)
        blank = torch.zeros(3, target.height, target.width)  # in place of the target's photo
        bounds = rig.NEAR, rig.FAR
        write_scene(folder, [blank, *photos.images], [target, *photos.cameras], bounds)
        model = MODELS / f"liveview_v{views}.onnx"
        options = ["--target", "000", "--layers", f"planes:{planes}", "--views", views, "--model", model]
        options += ["--alpha", "independent", "--threads", threads, "--json", "-o", folder.parent / "out.png"]
        self.command = [str(x) for x in (binary, "render", folder, *options)]

    def run(self) -> dict:
        before = processor_time_of_children()
        done = subprocess.run(self.command, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(done.stderr.strip())
        report = json.loads(done.stdout)
        seconds = report["targets"][0]["seconds"]
        stages = {"warp": seconds["warp"], "network": seconds["network"], "render": seconds["composite"]}
        spent = processor_time_of_children() - before  # of the whole process, which also reads the photos and the model
        return {"seconds": stages, "cpu_seconds": spent, "peak_memory": report["peak_memory_bytes"]}


def processor_time_of_children() -> float:
    """Seconds of processor time of ended child processes."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


@dataclass
class Row:
    """The measurements of one method on one number of planes."""

    name: str
    views: int
    planes: int
    runs: list[dict] = field(default_factory=list)
    worker: Worker | Program | None = None

    def report(self) -> dict:
        stages = {stage: median(r["seconds"][stage] for r in self.runs) for stage in ("warp", "network", "render")}
        totals = [sum(r["seconds"].values()) for r in self.runs]
        out = {"name": self.name, "views": self.views, "planes": self.planes, "stages": stages, "runs": len(totals)}
        out["seconds"] = {"median": median(totals), "lowest": min(totals), "highest": max(totals)}
        out["cpu_seconds"] = median(r["cpu_seconds"] for r in self.runs)
        out["peak_memory"] = max(r["peak_memory"] for r in self.runs)
        known = ("parameters", "memory_before", "multiply_adds")
        out |= {key: self.runs[0][key] for key in known if key in self.runs[0]}
        if "multiply_adds" in out:
            out["multiply_adds_per_pixel"] = out["multiply_adds"] / (rig.WIDTH * rig.HEIGHT)
        return out


def rows_of(entries: list[Entry]) -> list[Row]:
    """Each method for VIEWS photos, or the number it has, on its most planes; LiveView
    also on fewer."""
    chosen: dict[str, Entry] = {}
    for entry in sorted(entries, key=lambda e: e.views != VIEWS):
        chosen.setdefault(entry.name, entry)
    rows = []
    for name, entry in chosen.items():
        if not name.startswith("liveview_") and not entry.fewer:  # the same network with another training
            counts = (max(entry.planes), *FEWER_PLANES) if name == "liveview" else (max(entry.planes),)
            rows += [Row(entry.key, entry.views, count) for count in counts]
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument(
        "--only", nargs="+", metavar="METHOD", help=f"these methods alone, such as liveview_v5 or {PROGRAM}"
    )
    parser.add_argument("--binary", type=Path, default=BINARY)
    args = parser.parse_args()
    rows = [row for row in rows_of(ENTRIES) if not args.only or row.name in args.only]
    skipped = {}
    os.environ |= {"OMP_NUM_THREADS": str(args.threads), "OMP_WAIT_POLICY": "passive"}  # of the processes
    with tempfile.TemporaryDirectory() as folder:
        for row in rows:
            row.worker = Worker(row.name, row.planes, args.threads)
        if not args.only or PROGRAM in args.only:
            if args.binary.is_file():
                for planes in (64, *FEWER_PLANES):
                    own = Path(folder) / f"scene{planes}" / "photos"
                    own.mkdir(parents=True)
                    program = Program(args.binary.absolute(), own, planes, args.threads, VIEWS)
                    rows.append(Row(PROGRAM, VIEWS, planes, worker=program))
            else:
                skipped[PROGRAM] = f"{args.binary.name} is missing: make build"
        for round_ in range(args.rounds + 1):  # the first to warm up and to count operations
            for row in list(rows):
                try:
                    row.runs.append(row.worker.run())
                except (RuntimeError, BrokenProcessPool) as error:
                    skipped[f"{row.name}, {row.planes} planes"] = str(error)
                    rows.remove(row)
                    continue
                total = sum(row.runs[-1]["seconds"].values())
                print(f"round {round_}: {row.name}, {row.planes} planes: {total:.2f} s", file=sys.stderr, flush=True)
    for row in rows:  # the first run only warms up
        del row.runs[0]
    report = {"size": [rig.WIDTH, rig.HEIGHT], "threads": args.threads, "rounds": args.rounds, "cpu": machine()}
    report |= {"versions": versions(), "rows": [row.report() for row in rows], "skipped": skipped}
    args.out.parent.mkdir(parents=True, exist_ok=True)
    write(args.out, report)
    print("\n".join(f"skipped {name}: {why}" for name, why in skipped.items()), file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
