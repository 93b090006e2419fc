"""The evaluation's contact sheet: truth, ours, the best baseline, and the error of ours, a row for
each scene."""

import re

from PIL import Image, ImageDraw
from torch import Tensor

from ..data.image import picture

OURS = re.compile(r"(surface|guided|planes|select):[\d/]+")  # the names of methods with a network
PREFERRED = "surface:2", "guided:4"
WIDTH = 320  # of a picture on the sheet
LINE = 14  # height of the text above a picture, pixels
ERROR_GAIN = 4

Row = dict[str, Tensor]  # title -> picture [3, H, W]


def row_of(title: str, truth: Tensor, images: dict[str, Tensor], scores: dict) -> Row:
    """Of ours the first PREFERRED one, else the first; of the others the one with the highest PSNR;
    each if it was rendered."""

    def titled(name: str) -> str:
        return f"{name}: {scores[name]['psnr']:.2f} dB, {scores[name]['ssim']:.3f}, {scores[name]['lpips']:.3f}"

    ours = [name for name in images if OURS.fullmatch(name)]
    others = [name for name in images if name not in ours]
    pictures = {title: truth}
    if ours:
        own = next((name for name in PREFERRED if name in ours), ours[0])
        pictures[titled(own)] = images[own]
    if others:
        best = max(others, key=lambda name: scores[name]["psnr"])
        pictures[titled(best)] = images[best]
    if ours:
        pictures[f"error of {own}, times {ERROR_GAIN}"] = ERROR_GAIN * (images[own] - truth).abs()
    return pictures


def contact_sheet(rows: list[Row]) -> Image.Image:
    """All rows, each picture reduced to WIDTH, under its title."""
    sizes = [next(iter(row.values())).shape[1:] for row in rows]
    heights = [round(height * WIDTH / width) for height, width in sizes]
    sheet = Image.new("RGB", (max(map(len, rows)) * WIDTH, sum(heights) + LINE * len(rows)), "white")
    draw, top = ImageDraw.Draw(sheet), 0
    for row, height in zip(rows, heights, strict=True):
        for column, (title, image) in enumerate(row.items()):
            small = picture(image).resize((WIDTH, height), Image.Resampling.LANCZOS)
            draw.text((column * WIDTH + 2, top + 1), title, fill="black")
            sheet.paste(small, (column * WIDTH, top + LINE))
        top += height + LINE
    return sheet
