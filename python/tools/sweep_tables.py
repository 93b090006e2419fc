"""Tables and sentences about quality and time, from the reports in models/."""

import json
from pathlib import Path

MODELS = Path(__file__).resolve().parents[2] / "models"
CPU = "cpu, f32"
NO_NETWORK = "no network"
SURFACE, PLANES, FAST = "surface:3", "select:16/64", "guided:1"  # the layers of each --quality
ALL_ENGINES = "surface:1", "surface:2", "surface:3", "guided:1", "guided:2"
CPU_ONLY = "guided:4", "guided:8", "select:16/64", "planes:16", "planes:64"


def measured(views: int = 4) -> dict:
    """The report of `liveview sweep` on the example scene."""
    return json.loads((MODELS / "report" / f"v{views}" / "sweep.json").read_text())


def find(report: dict, layers: str, engine: str) -> dict:
    """The row of a kind of layers on an engine."""
    return next(row for row in report["rows"] if (row["layers"], row["engine"]) == (layers, engine))


def machine(report: dict) -> str:
    """What was measured, on what: goes with every table of times."""
    row = find(report, "planes:64", CPU)
    noisy = " **The machine was noisy.**" if report["noisy"] else ""
    return (
        f"Example scene, {row['width']}x{row['height']}, V = {report['views']} photos, "
        f"{report['threads']} threads of {report['cpu']}.{noisy}"
    )


def ways(report: dict) -> str:
    """README: the named ways to render, with quality and time."""
    ways = (
        ("a good picture", "*surface* (default)", SURFACE, NO_NETWORK),
        ("planes that compete", "`--quality planes`", PLANES, CPU),
        ("a single picture soonest", "*fast*: `--quality fast`", FAST, CPU),
    )
    lines = ["| I want | use | PSNR dB, SSIM | it costs, in seconds |", "|---|---|---|---|"]
    for want, use, layers, engine in ways:
        row = find(report, layers, engine)
        seconds = row["seconds"]
        cost = f"{seconds['median']:.2f} a picture"
        if seconds["once"]:
            what = "the selection" if layers == PLANES else "the photos' depth"
            cost += f"; {seconds['once']:.1f} once for {what}"
        lines.append(f"| {want} | {use} | {row['psnr']:.1f}, {row['ssim']:.2f} | {cost} |")
    return "\n".join(lines)


def excerpt(report: dict) -> str:
    """The sweep's main rows: every kind of layers on the CPU, the fastest ones on the
    other engines too; then the Python implementations, whose model and composite are others."""
    dense = find(report, "planes:64", CPU)["seconds"]
    runs = len(dense["all"])
    lines = [
        machine(report) + f" Batch {report['batch']}; PSNR and SSIM: means of the two held-out photos, without a",
        f"border of 16 pixels; seconds per picture: medians of {runs} interleaved runs.",
        "",
        "| layers | by | PSNR dB | SSIM | seconds per picture | times faster | MB |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in report["rows"]:
        if row.get("reference") or row["layers"] not in (*ALL_ENGINES, *(CPU_ONLY if row["engine"] == CPU else ())):
            continue
        seconds, memory = row["seconds"], row["peak_memory_bytes"] / 1e6
        once = f", once {seconds['once']:.2f}" if seconds["once"] > 0 else ""
        faster = dense["median"] / seconds["median"]
        lines.append(
            f"| {row['layers']} | {row['engine']} | {row['psnr']:.2f} | {row['ssim']:.4f} "
            f"| {seconds['median']:.2f}{once} | {faster:.1f} | {memory:.0f} |"
        )
    lines += [
        "",
        "Time and memory of Python implementations of planes:64, of the same photos and target, not to be compared in",
        "quality: they have `liveview_v4`, composited as in the paper, and no depth of the photos.",
        "",
        "| by | seconds per picture | MB |",
        "|---|---|---|",
    ]
    for row in report["rows"]:
        if row.get("reference"):
            seconds, memory = row["seconds"]["median"], row["peak_memory_bytes"] / 1e6
            lines.append(f"| {row['engine']} | {seconds:.2f} | {memory:.0f} |")
    return "\n".join(lines)


def int8_gain(report: dict) -> str:
    """How many times as fast int8 is as f32 on the CPU, on the guided layers that gain most.
    Surface layers have different networks in f32 and int8."""
    seconds: dict[str, dict[str, float]] = {}
    for row in report["rows"]:
        if row["layers"].startswith("guided"):
            seconds.setdefault(row["engine"], {})[row["layers"]] = row["seconds"]["median"]
    cpu, openvino = (
        max(seconds[CPU][layers] / taken for layers, taken in seconds[f"{engine}, int8"].items())
        for engine in ("cpu", "openvino")
    )
    return f"{cpu:.1f} times as fast ({openvino:.1f} times with OpenVINO)"


def mean_scores(model: str) -> dict[str, tuple[float, float, float]]:
    """Method -> PSNR dB, SSIM, LPIPS: the means over the scenes of `make models`, from
    a model's scores.md."""
    lines = (MODELS / f"{model}_scores" / "scores.md").read_text().splitlines()
    rows = [line.strip("| ").split(" | ") for line in lines if line.startswith("| ")][1:]
    return {name: (float(psnr), float(ssim), float(lpips)) for name, psnr, ssim, lpips, *_ in rows}


def network_gain() -> str:
    """What the network is worth, by kind of layers: the same layers with it and without."""
    any_layers = mean_scores("liveview_v4")
    competing = mean_scores("liveview_v4_planes")
    sweep = "sweep, planes:64", "plane sweep, winner takes all"
    rows = (
        ("64 planes, competing", competing["competing, planes:64"], sweep),
        ("2 guided layers", any_layers["guided:2"], ("sweep, guided:2", "plane sweep on them")),
        ("1 surface layer", any_layers["surface:1"], ("surface:1, no network", "agreement of the photos")),
        (
            "3 surface layers",
            of_set("liveview_v4_surface", "seven"),
            ("surface:3, no network", "agreement of the photos"),
        ),
    )
    lines = ["| layers | with the network | without | by |", "|---|---|---|---|"]
    for layers, scores, (baseline, name) in rows:
        lines.append(f"| {layers} | {shown(scores)} | {shown(any_layers[baseline])} | {name} |")
    return "\n".join(lines)


def of_set(model: str, name: str) -> tuple[float, float, float]:
    """Mean scores of a set of scenes by `make evaluate`."""
    means = json.loads((MODELS / f"{model}_scores" / "scores.json").read_text())["means"][name]
    return means["psnr"], means["ssim"], means["lpips"]


def gain_on_planes() -> str:
    """README: what the network earns on 64 competing planes over a plane sweep, in dB."""
    with_network = mean_scores("liveview_v4_planes")["competing, planes:64"][0]
    return f"{with_network - mean_scores('liveview_v4')['sweep, planes:64'][0]:.1f} dB"


def shown(scores: tuple[float, float, float]) -> str:
    return "{:.2f} / {:.3f} / {:.3f}".format(*scores)
