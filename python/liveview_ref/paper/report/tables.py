"""The tables of the report, with the paper's figures in italics, and a sentence for
each missing figure."""

from ..measure.variants import COMPETING
from ..methods.registry import entry
from .results import ABLATION, ABLATION_VIEWS, METRICS, ON_FEWER, ON_FEWER_VIEWS, Results, ablation_alone, title

DATA = {"rig": "rig scenes", "real": "real photos"}
PAPER_COLUMNS = {"deepfocus": "DeepFocus", "spaces": "Spaces"}
DASH = "–"


def table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def cell(row: dict | None) -> str:
    """PSNR dB ± standard error / SSIM / LPIPS."""
    if row is None:
        return DASH
    error = f" ± {row['psnr_se']:.2f}" if "psnr_se" in row else ""
    return f"{row['psnr']:.2f}{error} / " + " / ".join(f"{row[m]:.4f}" for m in METRICS[1:] if m in row)


def italic(values: list[float] | None) -> str:
    return "*" + " / ".join(f"{v:g}" for v in values) + "*" if values else DASH


def comparison_rows(results: Results) -> list[tuple[str, int, str]]:
    """(method, views, suffix of its layers): for each number of views the paper's rows in their
    order, then the rows that this project adds, without those of the ablations' figures alone;
    competing planes have a separate row."""
    published = [(row["method"], row["views"]) for row in results.published["comparison"]]
    ours = {row for data in DATA for row in results.methods(data) if not ablation_alone(*row)}
    rows = []
    for views in sorted({v for _, v in published} | {v for _, v in ours}):
        own = [row for row in published if row[1] == views]
        own += sorted((row for row in ours if row[1] == views and row not in own), key=lambda row: row[0])
        for method, _ in own:
            rows.append((method, views, ""))
            if any(has_competing(results, data, method, views) for data in DATA):
                rows.append((method, views, COMPETING))
    return rows


def has_competing(results: Results, data: str, method: str, views: int) -> bool:
    report = results.scores.get((data, method, views))
    return bool(report) and any(layers.endswith(COMPETING) for layers in report["mean"])


def comparison(results: Results) -> str:
    """Table 1. Columns of ours without any score are left out, except the rig's."""
    columns = [data for data in DATA if data == "rig" or results.methods(data)]
    head = ["V", "method", "planes", *(DATA[data] for data in columns)]
    head += [f"*{name}*" for name in PAPER_COLUMNS.values()]
    paper = {(row["method"], row["views"]): row for row in results.published["comparison"]}
    rows = []
    for method, views, suffix in comparison_rows(results):
        published = {} if suffix else paper.get((method, views), {})
        most = max((results.most_planes(data, method, views) for data in columns), default=0)
        ours = [cell(best_row(results, data, method, views, suffix)) for data in columns]
        italics = [italic(published.get(name)) for name in PAPER_COLUMNS]
        planes = f" *({published['planes']} planes)*" if "planes" in published else ""
        rows.append([str(views), title(method) + suffix + planes, str(most or DASH), *ours, *italics])
    return table(head, rows)


def best_row(results: Results, data: str, method: str, views: int, suffix: str) -> dict | None:
    return results.row(data, method, views, f"planes:{results.most_planes(data, method, views)}{suffix}")


def on_training_planes(results: Results, method: str, views: int, suffix: str = "") -> tuple[int, dict | None]:
    """The number of planes that a method's weights were trained on, and its scores with it: some
    networks need that number."""
    own = entry(f"{method}_v{views}")
    planes = own.planes_of(results.trained.get(own.weights_key, {}))
    return planes, results.row("rig", method, views, f"planes:{planes}{suffix}")


def longer(results: Results) -> str:
    """The methods that were trained for more samples, beside the same with fewer."""
    if not results.longer:
        return "Not trained yet."
    both, rows = (results, results.longer), []
    for method, views, suffix in comparison_rows(results.longer):
        if all(("rig", method, views) in each.scores for each in both):
            samples = " / ".join(f"{each.scores['rig', method, views]['about']['samples']:,}" for each in both)
            found = [on_training_planes(each, method, views, suffix) for each in both]
            planes = " / ".join(str(count) for count, _ in found)
            rows.append([str(views), title(method) + suffix, samples, planes, *(cell(row) for _, row in found)])
    return table(["V", "method", "samples", "planes", "before", "after"], rows) if rows else "Not scored yet."


def missing(results: Results) -> str:
    """A sentence for each cell of the paper's tables without a figure of ours."""
    lines = []
    for row in results.published["comparison"]:
        method, views = row["method"], row["views"]
        name = f"{title(method)}, {views} views"
        if results.row("rig", method, views, f"planes:{results.most_planes('rig', method, views)}") is None:
            lines.append(f"- {name}: not scored on the rig's scenes yet.")
        for column, heading in PAPER_COLUMNS.items():
            if column not in row:
                lines.append(f"- {name}, {heading}: the paper has no figure.")
        if not results.methods("real") or results.most_planes("real", method, views):
            continue
        lines.append(f"- {name}: not scored on real photos.")
    lines.append(f"- {' and '.join(PAPER_COLUMNS.values())}: the data is not part of this project.")
    if not results.methods("real"):
        lines.append("- Real photos: not scored yet.")
    measured = {(row["method"], row["planes"]) for row in cost_rows(results)}
    for row in results.published["speed"]:
        if (row["method"], row["planes"]) not in measured:
            lines.append(f"- {title(row['method'])}, {row['planes']} planes, run time: not measured yet.")
    lines += missing_ablations(results)
    return "\n".join(lines)


def missing_ablations(results: Results) -> list[str]:
    """A sentence for each missing curve of the ablations' figures."""
    scored, lines = results.methods("rig"), []
    for views in ABLATION_VIEWS:
        if names := [title(method) for method in ABLATION.values() if (method, views) not in scored]:
            lines.append(f"- Target or input, dynamic or static, {views} views: not scored yet: {'; '.join(names)}.")
    if names := [title(method) for method in ON_FEWER if (method, ON_FEWER_VIEWS) not in scored]:
        lines.append(f"- Networks trained on fewer planes: not scored yet: {'; '.join(names)}.")
    return lines


def cost_rows(results: Results) -> list[dict]:
    """Rows of cost.json with the method's name instead of its key."""
    return [{**row, "method": row["name"].rsplit("_v", 1)[0]} for row in results.cost.get("rows", [])]


def speed(results: Results) -> str:
    """Table 2."""
    if not results.cost:
        return "Not measured yet."
    paper = {(row["method"], row["planes"]): row for row in results.published["speed"]}
    order = {"program": 2, "liveview": 1}
    rows = []
    for row in sorted(cost_rows(results), key=lambda r: (order.get(r["method"], 0), r["method"], -r["planes"])):
        published = paper.get((row["method"], row["planes"]), {})
        total, stages = row["seconds"], row["stages"]
        spread = f"{total['median']:.2f} ({total['lowest']:.2f}–{total['highest']:.2f})"
        parameters = row.get("parameters")
        counted = row.get("multiply_adds_per_pixel") if parameters else None  # nothing is counted without a network
        rows.append([
            title(row["method"]), str(row["views"]), str(row["planes"]), spread,
            " / ".join(f"{stages[s]:.2f}" for s in ("warp", "network", "render")),
            f"{row['cpu_seconds']:.2f}",
            millions(counted), millions(2 * counted if counted is not None else None), millions(parameters),
            f"{row['peak_memory'] / 2**20:,.0f}",
            f"*{published['seconds']:g}*" if published else DASH,
            f"*{millions(published['operations_per_pixel'])}*" if published else DASH,
            f"*{millions(published['parameters'])}*" if published else DASH,
        ])  # fmt: skip
    head = [
        "method",
        "V",
        "planes",
        "s (lowest–highest)",
        "warp / network / render, s",
        "processor s",
        "multiply-adds per pixel",
    ]
    head += ["FLOP per pixel", "parameters", "peak MiB", "*s, V100*", "*OPX*", "*parameters*"]
    return table(head, rows)


def millions(value: float | None) -> str:
    if value is None:
        return DASH
    return f"{value / 1e6:.3g} M" if value >= 1e6 else f"{value / 1e3:.3g} K"


def speed_up(results: Results) -> str:
    """The paper's ratio and ours, by wall time and by processor time."""
    claim = results.published["speed_up"]
    published = {(row["method"], row["planes"]): row["seconds"] for row in results.published["speed"]}
    found = {(row["method"], row["planes"]): row for row in cost_rows(results)}
    slow = next((row for (method, _), row in found.items() if method == claim["over"]), None)

    def ratio(own: tuple[str, int]) -> str | None:
        if slow is None or own not in found:
            return None
        clock = slow["seconds"]["median"] / found[own]["seconds"]["median"]
        return f"{clock:.1f} times here ({slow['cpu_seconds'] / found[own]['cpu_seconds']:.1f} by processor time)"

    sentences = []
    for planes in (16, 64):
        own = (claim["of"], planes)
        pair = f"{title(own[0])} on {planes} planes is faster than {title(claim['over'])}"
        their = published[claim["over"], 64] / published[own]
        sentences.append(f"{pair}: *{their:.1f} times*, {ratio(own) or 'not measured here yet'}.")
    if program := ratio(("program", 16)):
        sentences.append(f"This program on 16 planes is faster than {title(claim['over'])} in PyTorch: {program}.")
    return f"The paper claims {claim['times']} times. " + " ".join(sentences)


def planes_table(results: Results, data: str = "rig") -> str:
    """LiveView on each number of planes, uniform and selected."""
    rows, counts = [], (8, 16, 32, 64)
    for method, views in results.methods(data):
        most = results.most_planes(data, method, views)
        for suffix in ("", COMPETING):
            for kind, pattern in (("uniform", "planes:{}"), (f"selected of {most}", f"select:{{}}/{most}")):
                cells = [results.row(data, method, views, pattern.format(n) + suffix) for n in counts]
                if any(cells):
                    texts = [f"{c['psnr']:.2f} / {c['ssim']:.4f}" if c else DASH for c in cells]
                    rows.append([str(views), title(method) + suffix, kind, *texts])
    return table(["V", "method", "planes", *map(str, counts)], rows) if rows else "Not scored yet."
