"""Write README.md's sentences about the paper's methods from the scores in models/paper: part of
`make paper`.

A sentence has one number of views: methods with different numbers are not compared.
"""

from pathlib import Path

from liveview_ref.paper.measure.variants import COMPETING
from liveview_ref.paper.report.results import Results, load
from liveview_ref.paper.report.tables import on_training_planes

from .marked_text import fill

ROOT = Path(__file__).resolve().parents[2]


def psnr(results: Results, method: str, views: int, composite: str = "") -> str | None:
    """Of a method on the planes of its training, in dB; None if it is not scored."""
    row = on_training_planes(results, method, views, composite)[1]
    return f"{row['psnr']:.1f}" if row else None


def headline(results: Results) -> str:
    """The paper's network against the strongest method trained beside it, by the longest training,
    then this program against Soft3D."""
    trained = results.longer or results
    own, other = (psnr(trained, method, 5) for method in ("liveview", "local_light_field"))
    competing = psnr(trained, "liveview", 5, COMPETING)
    program, soft3d = (psnr(results, method, 4) for method in ("liveview_no_network", "soft3d"))
    if not all((own, other, competing, program, soft3d)):
        return "Not scored yet."
    return (
        "Against [other methods](docs/paper-comparison.md), trained alike on generated scenes, V = 5: Local Light\n"
        f"Field reaches {other} dB, LiveView {own} by the paper's composite and {competing} by a softmax over planes.\n"
        f"V = 4: Soft3D, which needs no training, reaches {soft3d} dB, *surface* without a network {program}."
    )


def main() -> None:
    fill(ROOT / "README.md", {"paper": f"\n{headline(load(ROOT / 'models' / 'paper'))}"})


if __name__ == "__main__":
    main()
