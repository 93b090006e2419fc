"""JSON and other files that are never left half written."""

import json
from collections.abc import Callable
from pathlib import Path


def read(path: Path):
    """A JSON file; ValueError names the file if it is none."""
    try:
        return json.loads(path.read_text())
    except ValueError as error:
        raise ValueError(f"{path}: {error}; expected JSON") from error


def write(path: Path, report: dict | list) -> None:
    """Write JSON."""
    put(path, lambda temporary: temporary.write_text(json.dumps(report, indent=1) + "\n"))


def put(path: Path, save: Callable[[Path], object]) -> None:
    """Have `save` write a temporary file, then move it to `path`."""
    temporary = path.with_suffix(".tmp")
    save(temporary)
    temporary.rename(path)
