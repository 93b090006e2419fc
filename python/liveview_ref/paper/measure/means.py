"""Means of scores over targets and scenes."""

from statistics import fmean, stdev


def mean(targets: list[dict]) -> dict[str, dict[str, float]]:
    """Per kind of layers: the mean over scenes of the means over their targets, and its standard
    error (`_se`, over scenes, absent for a single one)."""
    out = {}
    for layers in targets[0]["scores"]:
        by_scene: dict[str, list[dict]] = {}
        for target in targets:
            by_scene.setdefault(target["scene"], []).append(target["scores"][layers])
        row = {}
        for metric in targets[0]["scores"][layers]:
            means = [fmean(scores[metric] for scores in rows) for rows in by_scene.values()]
            row[metric] = round(fmean(means), 5)
            if len(means) > 1:
                row[f"{metric}_se"] = round(stdev(means) / len(means) ** 0.5, 5)
        out[layers] = row
    return out
