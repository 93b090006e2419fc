"""Small line charts as SVG: panels side by side, one legend. The paper's figure:
PSNR and SSIM against the number of layers, from the evaluation's scores."""

import math
import re
from typing import NamedTuple

COLOURS = (
    "#d1495b", "#30638e", "#2e933c", "#edae49", "#7b4fa3", "#00a6a6", "#8d6a4f", "#e07be0", "#555555", "#9bc53d",
    "#1b1b8f", "#ff7f0e",
)  # fmt: skip
WIDTH, HEIGHT = 400, 300  # of a panel
LEFT, RIGHT, TOP, BOTTOM = 56, 16, 24, 44  # margins around its plot
LEGEND = 180  # width of a title in the legend

Points = list[tuple[float, float]]


class Panel(NamedTuple):
    """Titles of the vertical and horizontal axes, and the curves; `octaves` makes the horizontal
    axis logarithmic and labels each x."""

    up: str
    across: str
    curves: dict[str, Points]
    octaves: bool = False


def ticks(low: float, high: float) -> list[float]:
    """About five round numbers between two values."""
    raw = (high - low) / 5
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= raw)
    return [i * step for i in range(math.ceil(low / step), math.floor(high / step) + 1)]


def draw(panel: Panel, left: int, colours: dict[str, str]) -> list[str]:
    """SVG elements of one panel, `left` pixels from the edge of the chart."""
    points = [point for curve in panel.curves.values() for point in curve]
    scale = math.log2 if panel.octaves else float
    first, last = scale(min(x for x, _ in points)), scale(max(x for x, _ in points))
    slack = 0.08 * (max(y for _, y in points) - min(y for _, y in points)) or 1e-3
    low, high = min(y for _, y in points) - slack, max(y for _, y in points) + slack
    start, end, bottom = left + LEFT, left + WIDTH - RIGHT, HEIGHT - BOTTOM

    def x(value: float) -> float:
        return round(start + 10 + (end - start - 20) * (scale(value) - first) / ((last - first) or 1.0), 1)

    def y(value: float) -> float:
        return round(bottom - (bottom - TOP) * (value - low) / (high - low), 1)

    out = [f'<text x="{(start + end) / 2}" y="{TOP - 9}" text-anchor="middle">{panel.up}</text>']
    for tick in ticks(low, high):
        out.append(f'<path d="M{start} {y(tick)}H{end}" stroke="#ddd"/>')
        out.append(f'<text x="{start - 6}" y="{y(tick) + 4}" text-anchor="end">{tick:.4g}</text>')
    for tick in sorted({x for x, _ in points}) if panel.octaves else ticks(first, last + 1e-9):
        out.append(f'<text x="{x(tick)}" y="{bottom + 16}" text-anchor="middle">{tick:g}</text>')
    out.append(f'<text x="{(start + end) / 2}" y="{bottom + 34}" text-anchor="middle">{panel.across}</text>')
    out.append(f'<path d="M{start} {TOP}V{bottom}H{end}" fill="none" stroke="#333"/>')
    for title, curve in panel.curves.items():
        line = " ".join(f"{x(a)},{y(b)}" for a, b in curve)
        out.append(f'<polyline points="{line}" fill="none" stroke="{colours[title]}" stroke-width="2"/>')
        out += [f'<circle cx="{x(a)}" cy="{y(b)}" r="3.5" fill="{colours[title]}"/>' for a, b in curve]
    return out


def chart(panels: list[Panel]) -> str:
    """SVG of the panels that have any points."""
    panels = [panel for panel in panels if any(panel.curves.values())]
    titles = list(dict.fromkeys(title for panel in panels for title in panel.curves))
    colours = {title: COLOURS[index % len(COLOURS)] for index, title in enumerate(titles)}
    out = [line for index, panel in enumerate(panels) for line in draw(panel, index * WIDTH, colours)]
    across = max((len(panels) * WIDTH - LEFT) // LEGEND, 1)  # titles in a row of the legend
    for index, (title, colour) in enumerate(colours.items()):
        left, top = LEFT + LEGEND * (index % across), HEIGHT + 6 + 18 * (index // across)
        out.append(f'<circle cx="{left}" cy="{top}" r="3.5" fill="{colour}"/>')
        out.append(f'<text x="{left + 9}" y="{top + 4}">{title}</text>')
    rows = -(-len(titles) // across)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {len(panels) * WIDTH} {HEIGHT + 6 + 18 * rows}" '
        'font-family="sans-serif" font-size="12" fill="#222">'
    )
    return "\n".join([head, '<rect width="100%" height="100%" fill="white"/>', *out, "</svg>"]) + "\n"


CURVES = {  # title: pattern of the methods' names
    "surface layers": r"surface:(\d+)",
    "guided layers": r"guided:(\d+)",
    "uniform planes": r"planes:(\d+)",
    "selected of 64 planes": r"select:(\d+)/\d+",
}


def curves(mean: dict, metric: str) -> dict[str, Points]:
    """Points (layers, score) of each curve, fewest layers first. Selecting all planes gives the
    uniform ones."""
    found = {}
    for title, pattern in CURVES.items():
        points = [(m, row[metric]) for name, row in mean.items() if (m := re.fullmatch(pattern, name))]
        found[title] = sorted((int(m[1]), score) for m, score in points)
    if found["selected of 64 planes"]:
        found["selected of 64 planes"].append(found["uniform planes"][-1])
    return {title: points for title, points in found.items() if points}


def figure(mean: dict) -> str:
    """SVG of the scores {method: {metric: score}}."""
    panels = {"psnr": "PSNR, dB", "ssim": "SSIM"}
    return chart([Panel(up, "layers", curves(mean, metric), True) for metric, up in panels.items()])
