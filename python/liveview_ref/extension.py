"""The package `liveview` of this tree, from the wheel that `make wheel` builds; not installed."""

import importlib
import sys
import tempfile
import zipfile

from .paths import ROOT

WHEELS = sorted((ROOT / "target/wheels").glob("liveview-*.whl"), key=lambda path: path.stat().st_mtime)
if not WHEELS:
    raise ImportError(f"{ROOT / 'target/wheels'}: no wheel of liveview; expected one, which `make wheel` builds")

FOLDER = tempfile.TemporaryDirectory(prefix="liveview-", ignore_cleanup_errors=True)  # until this process ends
with zipfile.ZipFile(WHEELS[-1]) as archive:
    archive.extractall(FOLDER.name)
sys.path.insert(0, FOLDER.name)
liveview = importlib.import_module("liveview")
