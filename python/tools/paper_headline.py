"""Write README.md's line about the paper's methods from the scores in models/paper: part of `make paper-report`."""

from pathlib import Path

from liveview_ref.paper.results import COMPETING, Results, load, title

from .marked_text import fill

ROOT = Path(__file__).resolve().parents[2]
OURS = "liveview"  # what names of this project's methods start with


def rows(results: Results) -> list[tuple[float, float, str, int, str]]:
    """PSNR, SSIM, method, views and composite of each method on the rig's scenes, on its most planes; best first."""
    found = []
    for method, views in results.methods("rig"):
        for suffix in ("", COMPETING):
            row = results.row("rig", method, views, f"planes:{results.most_planes('rig', method, views)}{suffix}")
            if row and not method.startswith("input_centred"):
                found.append((row["psnr"], row["ssim"], method, views, suffix))
    return sorted(found, reverse=True)


def told(row: tuple[float, float, str, int, str]) -> str:
    psnr, ssim, method, views, suffix = row
    return f"{title(method)}{suffix} (V = {views}) {psnr:.1f} dB / {ssim:.3f}"


def headline(results: Results) -> str:
    """The strongest opponent and what this project has against it; then the best of those trained alike."""
    every = rows(results)
    trained = [r for r in every if results.scores["rig", r[2], r[3]]["about"].get("step")]
    pairs = []
    for kind in (every, trained):
        best = {ours: [r for r in kind if r[2].startswith(OURS) == ours][:1] for ours in (True, False)}
        if not all(best.values()):
            return "Not scored yet."
        pairs.append([told(best[ours][0]) for ours in (True, False)])
    report = results.scores["rig", *trained[0][2:4]]
    return (
        f"On {len(report['targets'])} targets of a rig that no network has seen, the strongest opponent is "
        f"{pairs[0][1]}; against it {pairs[0][0]}. Networks trained alike, for {report['about']['samples']:,} samples: "
        f"{pairs[1][0]}, {pairs[1][1]}."
    )


def main() -> None:
    fill(ROOT / "README.md", {"paper": headline(load(ROOT / "models" / "paper"))})


if __name__ == "__main__":
    main()
