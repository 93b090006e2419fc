"""Measure the layer policies of `liveview video` on a rig's clip: tables and
figures for models/report/live.

Each policy renders the held-out camera of the clip, in a separate process, several times in
interleaved runs (planes:64, the slowest and equally slow for every frame, once). Scores are those
of the first run, times the median over all. The paper's policy is also run from the cut on. Memory
is measured over one long, small video: the clip repeated.

Usage, in python/:
    python -m tools.live_report [--rig DIR] [--camera NAME] [--cut FRAME] [--layers SPEC ...]
        [-- OPTIONS OF liveview video]
"""

import argparse
import itertools
import json
import os
import subprocess
import tempfile
from pathlib import Path
from statistics import mean, median

from liveview_ref import layer_spec
from liveview_ref.evaluation.chart import Panel, chart

ROOT = Path(__file__).resolve().parents[2]
DENSE = "planes:64"  # the baseline of the comparison
PAPER = "select:16/64"  # its default policy is the paper's


def policies(specs: list[str]) -> dict[str, list[str]]:
    """The policies to compare, DENSE first: name -> options of `liveview video`."""
    pairs = itertools.product(specs, ("each", "propagate"))
    searched = {f"{layers} {policy}": ["--layers", layers, "--policy", policy] for layers, policy in pairs}
    return {DENSE: ["--layers", DENSE], PAPER: ["--layers", PAPER], **searched}


def video(args, rig: Path, folder: Path, *options: str) -> tuple[dict, list[dict]]:
    """One run: its report, and the log with a line per frame."""
    log = folder / "log.jsonl"
    command = [args.liveview, "video", str(rig), "--camera", args.camera, "--network", "model", "--json"]
    command += ["-o", str(folder / "frames"), "--log", str(log), *args.options, *options]
    report = subprocess.run(command, check=True, stdout=subprocess.PIPE, cwd=ROOT).stdout
    return json.loads(report), [json.loads(line) for line in log.read_text().splitlines()]


def milliseconds(line: dict) -> float:
    """Milliseconds of a frame, all stages together."""
    return 1e3 * sum(line["seconds"].values())


def rows(runs: dict[str, list[list[dict]]], reports: dict[str, dict], cut: int | None) -> list[str]:
    """A row per policy. Times leave out the first frame, which takes all policies but DENSE
    longer."""
    head = ["layers, policy", "PSNR dB", "SSIM", f"worst frame's SSIM against {DENSE}", "flicker, of 255"]
    head += ["ms per frame", "of these for layers", f"time, {DENSE} = 1", "source of layers, frames"]
    if cut is not None:
        head[5:5] = ["PSNR at the cut", "PSNR from the cut on"]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    dense = runs[DENSE]
    whole = median(mean(map(milliseconds, log[1:])) for log in dense)
    for policy, logs in runs.items():
        log, scores = logs[0], reports[policy]["mean"]
        times = median(mean(map(milliseconds, log[1:])) for log in logs)
        layers = median(mean(1e3 * line["seconds"]["layers"] for line in log[1:]) for log in logs)
        worst = min(line["ssim"] / other["ssim"] - 1 for line, other in zip(log, dense[0], strict=True))
        cells = [policy, f"{scores['psnr']:.2f}", f"{scores['ssim']:.4f}", f"{100 * worst:+.1f} %"]
        cells.append(f"{255 * scores['flicker']:.3f}")
        if cut is not None:
            cells += [f"{log[cut]['psnr']:.2f}", f"{mean(line['psnr'] for line in log[cut:]):.2f}"]
        cells += [f"{times:.1f}", f"{layers:.1f}", f"{times / whole:.3f}"]
        cells.append(", ".join(f"{how} {count}" for how, count in reports[policy]["layers_from"].items()))
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def looped(rig: Path, frames: int, folder: Path) -> Path:
    """The rig with its clip repeated up to this many frames, as links."""
    for name in ("transforms.json", "poses_bounds.npy"):
        if (rig / name).is_file():
            (folder / name).symlink_to(rig / name)
    for camera in filter(Path.is_dir, rig.iterdir()):
        photos = sorted(camera.glob("*.jpg"))
        (folder / camera.name).mkdir()
        for index, photo in enumerate(itertools.islice(itertools.cycle(photos), frames if photos else 0)):
            (folder / camera.name / f"{index:06}.jpg").symlink_to(photo)
    return folder


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rig", type=Path, default=ROOT / "tests/scenes/rig")
    parser.add_argument("--camera", default="target")
    parser.add_argument("--cut", type=int, help="the first frame after the hard cut")
    parser.add_argument("--layers", type=layer_spec.argument, nargs="+", default=["guided:2", "surface:1"])
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--memory-frames", type=int, default=1000, help="frames of the long video; 0: no video")
    parser.add_argument("--memory-width", type=int, default=252, help="width of its frames")
    parser.add_argument("--out", type=Path, default=ROOT / "models/report/live")
    parser.add_argument("--liveview", default=str(ROOT / "target/release/liveview"))
    parser.add_argument("options", nargs="*", help="options of liveview video, after --")
    args = parser.parse_args()
    args.rig, args.out = args.rig.resolve(), args.out.resolve()
    args.out.mkdir(parents=True, exist_ok=True)
    options_of = policies([str(layers) for layers in args.layers])
    runs, reports = {policy: [] for policy in options_of}, {}
    with tempfile.TemporaryDirectory() as folder:
        for repetition in range(args.repetitions):
            for policy in list(options_of)[min(repetition, 1) :]:
                report, log = video(args, args.rig, Path(folder), *options_of[policy])
                reports.setdefault(policy, report)
                runs[policy].append(log)
    panels = []
    for title, score in (("PSNR, dB", "psnr"), ("SSIM", "ssim")):
        curves = {policy: [(line["frame"], line[score]) for line in logs[0]] for policy, logs in runs.items()}
        panels.append(Panel(title, "frame", curves))
    (args.out / "policies.svg").write_text(chart(panels))
    last, log = list(reports.values())[-1], list(runs.values())[-1][0]
    about = f"{last['engine']['provider']}, {last['engine']['precision']}, V = {last['model']['views']}, "
    about += f"{last['engine']['threads']} threads"
    about += f", options: {' '.join(args.options)}" if args.options else ""
    text = [f"{args.camera} of {os.path.relpath(args.rig, ROOT)}, {len(log)} frames, {about}.", ""]
    text += rows(runs, reports, args.cut)
    if args.cut is not None:
        with tempfile.TemporaryDirectory() as folder:
            _, restarted = video(args, args.rig, Path(folder), *options_of[PAPER], "--frames", f"{args.cut}:")
        kept = runs[PAPER][0][args.cut + 1 :]
        text += [
            "",
            f"{PAPER} started at the cut: {mean(line['psnr'] for line in restarted[1:]):.2f} dB from its second frame "
            f"on; the planes of the first frame give {mean(line['psnr'] for line in kept):.2f} there.",
        ]
    if args.memory_frames:
        with tempfile.TemporaryDirectory() as links, tempfile.TemporaryDirectory() as folder:
            rig = looped(args.rig, args.memory_frames, Path(links))
            small = ["--layers", "surface:1", "--policy", "propagate", "--width", str(args.memory_width)]
            _, log = video(args, rig, Path(folder), *small)
        memory = [(line["frame"], line["memory_bytes"] / 1e6) for line in log]
        (args.out / "memory.svg").write_text(
            chart([Panel("memory in use, MB", "frame", {"surface:1 propagate": memory})])
        )
        early, late = memory[len(memory) // 10][1], memory[-1][1]
        text += [
            "",
            f"Memory over {args.memory_frames} frames (the clip repeated, {args.memory_width} pixels wide, surface:1, "
            f"propagate): {early:.0f} MB after a tenth, {late:.0f} MB at the end.",
        ]
    (args.out / "policies.md").write_text("\n".join(text) + "\n")


if __name__ == "__main__":
    main()
