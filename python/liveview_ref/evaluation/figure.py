"""The paper's figure from the evaluation's scores: PSNR and SSIM against the number of layers."""

import re

from .chart import Panel, Points, chart

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
