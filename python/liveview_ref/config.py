"""Training configs."""

import json
from pathlib import Path


def read_config(path: Path) -> dict:
    """A config file; fields that it does not have come from the file in the same folder that its
    "base" names."""
    config = json.loads(path.read_text())
    return read_config(path.parent / config.pop("base")) | config if "base" in config else config
