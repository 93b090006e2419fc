"""Keep what was trained, and write its card: python -m liveview_ref.paper.cards [--runs RUNS]

With `--runs` the averaged weights of every checkpoint there are kept in models/paper/weights, laid out as in RUNS, so
that `score --runs` and `train --start` read them. Weights above LIMIT stay out: a left_out.json in their place tells of
them. models/paper/README.md is then written from what lies in models/paper alone."""

import argparse
import sys
from pathlib import Path

from ..checkpoint import load_state
from ..training.fine_tune import save
from . import samples, scenes, train
from .methods.liveview import competing
from .registry import ENTRIES, Entry
from .results import put, title, write
from .results import read as read_json
from .scoring import weights_key
from .tables import DASH, table

HERE = Path(__file__).parent
MODELS = HERE.parents[2] / "models" / "paper"
LIMIT = 4_000_000  # bytes of weights
TOLD = "key", "step", "seconds", "history"
LEFT_OUT = (*TOLD, "samples", "parameters", "bytes")


def checked(path: Path, state, names: tuple[str, ...], entry: Entry) -> dict:
    """These fields of a state of that entry."""
    missing = [name for name in names if name not in state] if isinstance(state, dict) else names
    if missing:
        raise ValueError(f"{path}: {', '.join(missing)}: missing; expected {', '.join(names)}")
    if state["key"] != entry.key:
        raise ValueError(f"{path}: key: {state['key']}; expected {entry.key}, as its folder is called")
    return {name: state[name] for name in names}


def read(entry: Entry, path: Path) -> dict:
    """What is kept of a checkpoint, or was. ValueError, which names the file, where it is not one of that entry."""
    try:
        state = load_state(path)
    except Exception as error:  # a damaged pickle may raise anything
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise ValueError(f"{path}: {reason}; expected a checkpoint of training") from error
    kept = checked(path, state, (*TOLD, "average"), entry)
    method = entry.build(entry.views)
    try:
        method.load_state_dict(kept["average"])
    except (RuntimeError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: average: {error}; expected the weights of {entry.key}") from error
    kept["samples"] = state.get("samples", state["step"] * train.BATCH)
    kept["parameters"] = sum(weight.numel() for weight in method.parameters())
    return kept


def keep(runs: Path, weights: Path) -> list[str]:
    """Keep the averaged weights of a training; a line of each entry. Nothing is written unless all can be read."""
    paths = {entry.key: runs / entry.key / "checkpoint.pt" for entry in ENTRIES if entry.trained}
    found = {e.key: read(e, paths[e.key]) for e in ENTRIES if e.trained and paths[e.key].exists()}
    if not found:
        raise ValueError(f"{runs}: no METHOD/checkpoint.pt; expected a folder that training wrote")
    lines = [f"{key}: not in {runs}" for key in paths if key not in found]
    for key, state in found.items():
        folder = weights / key
        folder.mkdir(parents=True, exist_ok=True)
        size = sum(value.nbytes for value in state["average"].values())
        if size <= LIMIT:
            save(folder / "checkpoint.pt", **state)
            (folder / "left_out.json").unlink(missing_ok=True)
        else:
            write(folder / "left_out.json", {name: (state | {"bytes": size})[name] for name in LEFT_OUT})
            (folder / "checkpoint.pt").unlink(missing_ok=True)
        lines.append(f"{key}: step {state['step']}, {megabytes(size)}{'' if size <= LIMIT else ', left out'}")
    return lines


def megabytes(size: int) -> str:
    return f"{size / 1e6:.1f} MB"


def row(entry: Entry, models: Path) -> list[str] | None:
    """The cells of an entry; None where nothing was kept of it."""
    file, left_out = (models / "weights" / entry.key / name for name in ("checkpoint.pt", "left_out.json"))
    if file.exists():
        state, name = read(entry, file), file.relative_to(models).as_posix()
        where = f"[{name}]({name}), {megabytes(file.stat().st_size)}"
    elif left_out.exists():
        state = checked(left_out, read_json(left_out), LEFT_OUT, entry)
        where = f"not kept: {megabytes(state['bytes'])}, above {megabytes(LIMIT)}"
    else:
        return None
    last = state["history"][-1] if state["history"] else None
    psnr = f"{last['psnr']:.2f}" if last else DASH
    if last and last["step"] != state["step"]:
        psnr += f" at step {last['step']:,}"
    counts = [f"{state[name]:,}" for name in ("parameters", "step", "samples")]
    start = [title(entry.name), str(entry.views), str(entry.training_planes)]
    return [*start, *counts, f"{state['seconds'] / 3600:.2f}", psnr, where]


def card(models: Path) -> str:
    """The text of models/paper/README.md."""
    entries = [entry for entry in ENTRIES if entry.trained]
    rows = {entry.key: row(entry, models) for entry in entries}
    head = ["method", "V", "planes", "parameters", "steps", "samples", "core hours", "validation, dB", "weights"]
    missing = [f"`{key}`" for key, cells in rows.items() if cells is None]
    borrowed = [f"{title(e.name)} renders with the weights of `{weights_key(e)}`" for e in ENTRIES if e.weights]
    parts = {
        "trained": table(head, [cells for cells in rows.values() if cells]),
        "missing": f" Nothing kept yet of {', '.join(missing)}." if missing else "",
        "borrowed": "; ".join(borrowed),
        "non_commercial": ", ".join(f"`{entry.key}`" for entry in entries if entry.build is competing),
        "curves": "![Training](training.svg)" if (models / "training.svg").exists() else "No curves are drawn yet.",
    }
    return (HERE / "cards.md").read_text().format(**parts, samples=samples, scenes=scenes, train=train)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=Path, help="keep the weights of this training on the rig's scenes first")
    args = parser.parse_args()
    try:
        for line in keep(args.runs, MODELS / "weights") if args.runs else ():
            print(line)
        text = card(MODELS)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    put(MODELS / "README.md", lambda path: path.write_text(text))
    return 0


if __name__ == "__main__":
    sys.exit(main())
