"""Training configs."""

import json
from pathlib import Path


def read_config(path: Path) -> dict:
    """A config file; what it leaves out stands in the file that its "base" names, beside it."""
    config = json.loads(path.read_text())
    return read_config(path.parent / config.pop("base")) | config if "base" in config else config
