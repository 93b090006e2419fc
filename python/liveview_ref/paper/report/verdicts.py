"""The paper's claims against the scores, as sentences generated from them."""

from ..measure.variants import COMPETING
from .results import ABLATION, ABLATION_VIEWS, OWN_VARIANTS, PRETRAINED, Results, counted, title
from .tables import on_training_planes

OURS = ("liveview", *PRETRAINED)


def verdicts(results: Results, data: str = "rig") -> str:
    """For LiveView and each number of views: the better composite, whether more planes are better,
    the loss by selection, and the best other method."""
    lines = []
    for method, views in results.methods(data):
        if method in OURS:
            lines += [f"- **{title(method)}, V = {views}**: " + " ".join(sentences(results, data, method, views))]
    return "\n".join(lines) if lines else "LiveView is not scored yet."


def sentences(results: Results, data: str, method: str, views: int) -> list[str]:
    report, counts = results.scores[data, method, views], results.plane_counts(data, method, views)
    most = counts[-1]
    rows = {suffix: results.row(data, method, views, f"planes:{most}{suffix}") for suffix in ("", COMPETING)}
    best = max((s for s in rows if rows[s]), key=lambda suffix: rows[suffix]["psnr"])
    alone, together = rows[""]["psnr"], (rows[COMPETING] or {}).get("psnr")
    both = f"{alone:.2f} dB by the paper's composite" + (
        f", {together:.2f} dB competing (scale {report['scale']:g})" if together else ""
    )
    out = [f"{both} on {most} planes."]
    curve = [results.row(data, method, views, f"planes:{n}{best}")["psnr"] for n in counts]
    rising = all(a < b for a, b in zip(curve[:-1], curve[1:], strict=True))
    numbers = ", ".join(f"{value:.2f}" for value in curve)
    planes = f"{', '.join(map(str, counts[:-1]))} and {most} planes"
    out.append(f"{planes}: {numbers} dB, {'rising' if rising else 'not rising throughout'}.")
    if selected := results.row(data, method, views, f"select:16/{most}{best}"):
        change = selected["ssim"] / rows[best]["ssim"] - 1
        all_of_them = f"{rows[best]['ssim']:.4f} on all ({change:+.2%})"
        out.append(f"16 selected planes: SSIM {selected['ssim']:.4f}, {all_of_them}.")
    others = [
        (results.row(data, m, v, f"planes:{results.most_planes(data, m, v)}")["psnr"], m)
        for m, v in results.methods(data)
        if v == views and not m.startswith(("liveview", *OWN_VARIANTS))
    ]
    if others:
        psnr, name = max(others)
        out.append(
            f"The best other method: {title(name)}, {psnr:.2f} dB ({rows[best]['psnr'] - psnr:+.2f} dB for LiveView)."
        )
    if report["about"].get("step"):
        out.append(f"Trained for {report['about']['step']:,} steps; {counted(len(report['targets']), 'target')}.")
    return out


def longer_verdicts(results: Results) -> str:
    """For each number of views: LiveView by the paper's composite against each other network, after
    longer training."""
    rows = results.longer.methods("rig") if results.longer else []
    lines = []
    for views in [v for m, v in rows if m == "liveview"]:
        own_planes, own = on_training_planes(results.longer, "liveview", views)
        for method in [m for m, v in rows if v == views and m != "liveview"]:
            planes, row = on_training_planes(results.longer, method, views)
            other = f"{title(method)} {row['psnr']:.2f}" + (f" on {planes}" if planes != own_planes else "")
            lead = own["psnr"] - row["psnr"]
            found = f"LiveView {own['psnr']:.2f} dB on {own_planes} planes, {other}"
            lines.append(f"- **V = {views}**: {found} ({lead:+.2f} dB for LiveView).")
    return "\n".join(lines)


def ablation_verdicts(results: Results) -> str:
    """For each number of views with all four methods of the ablation, by the paper's composite: the
    gain of each of the two choices on 64 planes, and the loss of 16 planes against them."""
    lines = []
    for views in ABLATION_VIEWS:
        rows = {
            name: [results.row("rig", method, views, f"planes:{n}") for n in (16, 64)]
            for name, method in ABLATION.items()
        }
        if not all(row for pair in rows.values() for row in pair):
            continue
        few, many = ({name: pair[i]["psnr"] for name, pair in rows.items()} for i in (0, 1))
        centred, seen = (
            [many[name] - many[name.replace(a, b)] for name in many if a in name]
            for a, b in (("target-centred", "input-centred"), ("dynamic", "static"))
        )
        losses = "; ".join(f"{name} {few[name] - many[name]:+.2f}" for name in many)
        lines.append(
            f"- **V = {views}**, 64 planes: target-centred instead of input-centred {centred[0]:+.2f} dB (dynamic) and "
            f"{centred[1]:+.2f} dB (static); dynamic instead of static {seen[0]:+.2f} dB (target-centred) and "
            f"{seen[1]:+.2f} dB (input-centred). 16 planes in place of 64, dB: {losses}."
        )
    return "\n".join(lines) if lines else "Not scored for all four yet."
