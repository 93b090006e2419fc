"""Write README.md's line about the paper's methods from the scores in models/paper: part of `make paper-report`."""

from pathlib import Path
from typing import NamedTuple

from liveview_ref.paper.results import BEGUN_ELSEWHERE, COMPETING, ON_FEWER, OWN_VARIANTS, Results, load, title
from liveview_ref.paper.tables import best_row

from .marked_text import fill

ROOT = Path(__file__).resolve().parents[2]
OURS = "liveview"  # what names of this project's methods start with


class Scored(NamedTuple):
    """A method on its most planes, by one composite."""

    psnr: float
    ssim: float
    method: str
    views: int
    suffix: str

    def __str__(self) -> str:
        return f"{title(self.method)}{self.suffix} (V = {self.views}) {self.psnr:.1f} dB / {self.ssim:.3f}"


def rows(results: Results) -> list[Scored]:
    """All methods on the rig's scenes, best first."""
    found = []
    for method, views in results.methods("rig"):
        for suffix in ("", COMPETING):
            row = best_row(results, "rig", method, views, suffix)
            if row and not method.startswith(OWN_VARIANTS) and method not in ON_FEWER:
                found.append(Scored(row["psnr"], row["ssim"], method, views, suffix))
    return sorted(found, reverse=True)


def headline(results: Results) -> str:
    """The strongest opponent and what this project has against it; then the best of those trained alike."""
    every = rows(results)
    alike = [row for row in every if row.method not in BEGUN_ELSEWHERE]
    trained = [row for row in alike if results.scores["rig", row.method, row.views]["about"].get("step")]
    pairs = []
    for kind in (every, trained):
        own = [row for row in kind if row.method.startswith(OURS)]
        others = [row for row in kind if not row.method.startswith(OURS)]
        if not own or not others:
            return "Not scored yet."
        pairs.append((own[0], others[0]))
    report = results.scores["rig", trained[0].method, trained[0].views]
    return (
        f"On {len(report['targets'])} targets in scenes that no network has seen, the strongest opponent is "
        f"{pairs[0][1]}; against it {pairs[0][0]}. Networks trained alike, for {report['about']['samples']:,} samples: "
        f"{pairs[1][0]}, {pairs[1][1]}."
    )


def main() -> None:
    fill(ROOT / "README.md", {"paper": headline(load(ROOT / "models" / "paper"))})


if __name__ == "__main__":
    main()
