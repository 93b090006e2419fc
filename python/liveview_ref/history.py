"""Draw how the validation of trainings went: python -m liveview_ref.history MODEL.pt ... CURVES.svg"""

import sys
from pathlib import Path

import torch

from .chart import Panel, chart


def main() -> None:
    *models, picture = (Path(name) for name in sys.argv[1:])
    panels = []
    for model in models:
        state = torch.load(model, weights_only=True)
        kinds = [kind for kind in state["history"][0] if kind not in ("step", "seconds")]
        curves = {kind: [(row["step"], row[kind]) for row in state["history"]] for kind in kinds}
        panels.append(Panel(f"V = {state['views']}: PSNR of validation, dB", "steps", curves))
    picture.write_text(chart(panels))


if __name__ == "__main__":
    main()
