"""Record the trainings, and write their card.

    python -m liveview_ref.paper.report.cards [--runs RUNS] [--training FILE]

With `--runs`, FILE (models/paper/training.json) takes the figures of every checkpoint there: steps,
processor time, planes, parameters and validation. The weights themselves stay in RUNS.
models/paper/README.md is then written from models/paper/training.json alone."""

import argparse
import sys
from pathlib import Path

from liveview_ref.checkpoint import load_state
from liveview_ref.paths import MODELS

from .. import train
from ..data import samples, scenes
from ..files import put, read, write
from ..methods.liveview import competing
from ..methods.registry import ENTRIES, Entry
from .results import title
from .tables import DASH, table

HERE = Path(__file__).parent
FIELDS = "key", "step", "seconds", "history", "average"  # of a checkpoint


def figures_of(entry: Entry, path: Path) -> dict:
    """The figures of a training. ValueError names a file that is not a checkpoint of this entry."""
    try:
        state = load_state(path)
    except Exception as error:  # a damaged pickle may raise anything
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise ValueError(f"{path}: {reason}; expected a checkpoint of training") from error
    missing = [name for name in FIELDS if name not in state] if isinstance(state, dict) else FIELDS
    if missing:
        raise ValueError(f"{path}: {', '.join(missing)}: missing; expected {', '.join(FIELDS)}")
    if state["key"] != entry.key:
        raise ValueError(f"{path}: key: {state['key']}; expected {entry.key}, as its folder is called")
    method = entry.build(entry.views)
    try:
        method.load_state_dict(state["average"])
    except (RuntimeError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: average: {error}; expected the weights of {entry.key}") from error
    figures = {"step": state["step"], "samples": state["step"] * train.BATCH, "seconds": round(state["seconds"])}
    figures["planes"] = entry.planes_of(state)
    figures["parameters"] = sum(weight.numel() for weight in method.parameters())
    return figures | {"history": state["history"]}


def record(runs: Path, file: Path) -> list[str]:
    """Write the figures of the trainings to `file`; a line of each entry. Nothing is written unless
    all can be read."""
    paths = {entry.key: runs / entry.key / "checkpoint.pt" for entry in ENTRIES if entry.trained}
    found = {e.key: figures_of(e, paths[e.key]) for e in ENTRIES if e.trained and paths[e.key].exists()}
    if not found:
        raise ValueError(f"{runs}: no METHOD/checkpoint.pt; expected the output folder of training")
    file.parent.mkdir(parents=True, exist_ok=True)
    write(file, (read(file) if file.exists() else {}) | found)
    return [f"{key}: step {found[key]['step']}" if key in found else f"{key}: not in {runs}" for key in paths]


def row(entry: Entry, figures: dict) -> list[str]:
    """The cells of an entry."""
    last = figures["history"][-1] if figures["history"] else None
    psnr = f"{last['psnr']:.2f}" if last else DASH
    if last and last["step"] != figures["step"]:
        psnr += f" at step {last['step']:,}"
    counts = [f"{figures[name]:,}" for name in ("parameters", "step", "samples")]
    start = [title(entry.name), str(entry.views), str(entry.planes_of(figures))]
    return [*start, *counts, f"{figures['seconds'] / 3600:.2f}", psnr]


def card(models: Path) -> str:
    """The text of models/paper/README.md."""
    path = models / "training.json"
    trained = read(path) if path.exists() else {}
    entries = [entry for entry in ENTRIES if entry.trained]
    head = ["method", "V", "planes", "parameters", "steps", "samples", "core hours", "validation, dB"]
    missing = [f"`{entry.key}`" for entry in entries if entry.key not in trained]
    borrowed = [f"{title(e.name)} renders with the weights of `{e.weights_key}`" for e in ENTRIES if e.weights]
    parts = {
        "trained": table(head, [row(entry, trained[entry.key]) for entry in entries if entry.key in trained]),
        "missing": f" Not trained yet: {', '.join(missing)}." if missing else "",
        "borrowed": "; ".join(borrowed),
        "hours": f"{sum(figures['seconds'] for figures in trained.values()) / 3600:.1f}",
        "non_commercial": ", ".join(f"`{entry.key}`" for entry in entries if entry.build is competing),
        "curves": "![Training](training.svg)" if (models / "training.svg").exists() else "No curves are drawn yet.",
    }
    return (HERE / "cards.md").read_text().format(**parts, samples=samples, scenes=scenes, train=train)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=Path, help="record the trainings on the rig's scenes in this folder first")
    models = MODELS / "paper"
    parser.add_argument("--training", type=Path, default=models / "training.json", help="the file of these figures")
    args = parser.parse_args()
    try:
        for line in record(args.runs, args.training) if args.runs else ():
            print(line)
        text = card(models)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    put(models / "README.md", lambda path: path.write_text(text))
    return 0


if __name__ == "__main__":
    sys.exit(main())
