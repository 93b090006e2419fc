"""The paper's figure from our own data: score against number of layers, as a small SVG of two panels, PSNR and SSIM."""

import math
import re

PANELS = {"psnr": "PSNR, dB", "ssim": "SSIM"}
CURVES = {  # title: (what the methods' names look like, colour)
    "guided layers": (r"guided (\d+)", "#d1495b"),
    "uniform planes": (r"planes (\d+)", "#30638e"),
    "selected of 64 planes": (r"selected (\d+) of \d+", "#2e933c"),
}
WIDTH, HEIGHT = 400, 300  # of a panel
LEFT, RIGHT, TOP, BOTTOM = 56, 16, 24, 44  # margins around its plot


def curves(mean: dict, metric: str) -> dict[str, list[tuple[int, float]]]:
    """Points (layers, score) of each curve, fewest layers first. All planes selected are the uniform ones."""
    found = {}
    for title, (pattern, _) in CURVES.items():
        points = [(m, row[metric]) for name, row in mean.items() if (m := re.fullmatch(pattern, name))]
        found[title] = sorted((int(m[1]), score) for m, score in points)
    if found["selected of 64 planes"]:
        found["selected of 64 planes"].append(found["uniform planes"][-1])
    return {title: points for title, points in found.items() if points}


def ticks(low: float, high: float) -> list[float]:
    """Round numbers, about five, that lie between."""
    raw = (high - low) / 5
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= raw)
    return [i * step for i in range(math.ceil(low / step), math.floor(high / step) + 1)]


def panel(mean: dict, metric: str, left: int) -> list[str]:
    """SVG elements of one panel, `left` pixels from the edge of the figure."""
    points = curves(mean, metric)
    layers = sorted({x for curve in points.values() for x, _ in curve})
    scores = [y for curve in points.values() for _, y in curve]
    slack = 0.08 * (max(scores) - min(scores)) or 1e-3
    low, high = min(scores) - slack, max(scores) + slack
    octaves = math.log2(layers[-1] / layers[0]) or 1.0

    def x(count: int) -> float:
        inner = WIDTH - LEFT - RIGHT - 20
        return round(left + LEFT + 10 + inner * math.log2(count / layers[0]) / octaves, 1)

    def y(score: float) -> float:
        return round(HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (score - low) / (high - low), 1)

    start, end, bottom = left + LEFT, left + WIDTH - RIGHT, HEIGHT - BOTTOM
    out = [f'<text x="{(start + end) / 2}" y="{TOP - 9}" text-anchor="middle">{PANELS[metric]}</text>']
    for tick in ticks(low, high):
        out.append(f'<path d="M{start} {y(tick)}H{end}" stroke="#ddd"/>')
        out.append(f'<text x="{start - 6}" y="{y(tick) + 4}" text-anchor="end">{tick:.4g}</text>')
    for count in layers:
        out.append(f'<text x="{x(count)}" y="{bottom + 16}" text-anchor="middle">{count}</text>')
    out.append(f'<text x="{(start + end) / 2}" y="{bottom + 34}" text-anchor="middle">layers</text>')
    out.append(f'<path d="M{start} {TOP}V{bottom}H{end}" fill="none" stroke="#333"/>')
    for title, curve in points.items():
        colour = CURVES[title][1]
        line = " ".join(f"{x(count)},{y(score)}" for count, score in curve)
        out.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
        out += [f'<circle cx="{x(count)}" cy="{y(score)}" r="3.5" fill="{colour}"/>' for count, score in curve]
    return out


def figure(mean: dict) -> str:
    """SVG of the scores {method: {metric: score}}."""
    out = []
    if curves(mean, "psnr"):
        for index, metric in enumerate(PANELS):
            out += panel(mean, metric, index * WIDTH)
    for index, (title, (_, colour)) in enumerate(CURVES.items()):
        left = LEFT + 180 * index
        out.append(f'<circle cx="{left}" cy="{HEIGHT + 6}" r="3.5" fill="{colour}"/>')
        out.append(f'<text x="{left + 9}" y="{HEIGHT + 10}">{title}</text>')
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {2 * WIDTH} {HEIGHT + 24}" '
        'font-family="sans-serif" font-size="12" fill="#222">'
    )
    return "\n".join([head, '<rect width="100%" height="100%" fill="white"/>', *out, "</svg>"]) + "\n"
