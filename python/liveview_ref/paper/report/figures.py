"""The pictures of the report: charts as SVG, and the same crop by each method."""

from pathlib import Path

from PIL import Image, ImageDraw

from liveview_ref.evaluation.chart import Panel, Points, chart

from ..measure.variants import COMPETING
from .results import ABLATION, ABLATION_VIEWS, DYNAMIC_STATIC, ON_FEWER, ON_FEWER_VIEWS, Results, ablation_alone, title

UP = {"psnr": "PSNR, dB", "ssim": "SSIM"}
LABEL_HEIGHT = 16  # pixels of text under a crop
CROPS_PER_ROW = 5


def points(results: Results, method: str, views: int, metric: str, pattern: str, data: str = "rig") -> Points:
    """(planes, score) of the layers named by `pattern`."""
    counts = results.plane_counts(data, method, views)
    found = [(n, results.row(data, method, views, pattern.format(n))) for n in counts]
    return [(n, row[metric]) for n, row in found if row]


def ablation(results: Results) -> str | None:
    """The paper's figure of all four combinations, for each number of views with at least two of
    them; None without any."""
    every = [v for method, v in results.methods("rig") if method in ABLATION.values()]
    panels = []
    for views in [v for v in ABLATION_VIEWS if every.count(v) > 1]:
        panels += compared(results, views, ABLATION)
    return chart(panels) if panels else None


def trained_planes(results: Results) -> str | None:
    """The paper's figure of networks trained on other numbers of planes; None if none is scored."""
    if not any((method, ON_FEWER_VIEWS) in results.methods("rig") for method in ON_FEWER):
        return None
    methods = {title(method): method for method in (*ON_FEWER, *DYNAMIC_STATIC)}
    return chart(compared(results, ON_FEWER_VIEWS, methods), legend=320)


def compared(results: Results, views: int, methods: dict[str, str]) -> list[Panel]:
    """A panel for each metric: scores against planes, a curve for each method with scores."""
    panels = []
    for metric, up in UP.items():
        curves = {name: points(results, method, views, metric, "planes:{}") for name, method in methods.items()}
        panels.append(Panel(f"{up}, V = {views}", "planes", {k: v for k, v in curves.items() if v}, True))
    return panels


def selection(results: Results) -> str | None:
    """Uniform and selected planes of LiveView, a panel for each number of views; None without
    any."""
    panels = []
    for views in [v for m, v in results.methods("rig") if m == "liveview"]:
        most = results.most_planes("rig", "liveview", views)
        curves = {}
        for suffix in ("", COMPETING):
            uniform = points(results, "liveview", views, "ssim", f"planes:{{}}{suffix}")
            selected = points(results, "liveview", views, "ssim", f"select:{{}}/{most}{suffix}")
            curves[f"uniform{suffix}"] = uniform
            curves[f"selected{suffix}"] = selected + uniform[-1:] if selected else []
        panels.append(Panel(f"SSIM, V = {views}", "planes", {k: v for k, v in curves.items() if v}, True))
    return chart(panels) if panels else None


def training(results: Results) -> str | None:
    """Validation of every training against thousands of samples, a panel for each number of views;
    None without any."""
    by_views: dict[int, dict[str, Points]] = {}
    for key, figures in results.trained.items():
        method, _, views = key.rpartition("_v")
        curve = [(row["samples"] / 1000, row["psnr"]) for row in figures["history"]]
        if curve:
            by_views.setdefault(int(views), {})[title(method)] = curve
    panels = [Panel(f"PSNR of validation, dB, V = {v}", "thousands of samples", by_views[v]) for v in sorted(by_views)]
    return chart(panels, legend=240) if panels else None


def crops(folder: Path) -> Image.Image | None:
    """The crops that scoring wrote of the compared methods, truth first, labelled with their
    methods; None without any."""
    truth = folder / "truth.webp"
    if not truth.exists():
        return None
    found = [(truth, "truth")]
    for path in sorted(folder.glob("*_v*.webp")):
        name, competing = path.stem.removesuffix("_competing"), path.stem.endswith("_competing")
        method, _, views = name.rpartition("_v")
        if not ablation_alone(method, int(views)):
            found.append((path, f"{title(method)}{COMPETING if competing else ''}, V = {views}"))
    pictures = [(Image.open(path).convert("RGB"), label) for path, label in found]
    width, height = pictures[0][0].size
    width *= 2  # enlarged to make pixels visible
    height *= 2
    rows = -(-len(pictures) // CROPS_PER_ROW)
    sheet = Image.new("RGB", (min(len(pictures), CROPS_PER_ROW) * width, rows * (height + LABEL_HEIGHT)), "white")
    draw = ImageDraw.Draw(sheet)
    for index, (picture, label) in enumerate(pictures):
        left, top = index % CROPS_PER_ROW * width, index // CROPS_PER_ROW * (height + LABEL_HEIGHT)
        sheet.paste(picture.resize((width - 4, height), Image.Resampling.NEAREST), (left, top))
        draw.text((left + 2, top + height + 2), label, fill="black")
    return sheet
