"""The layout of the repository: sizes of folders, pinned packages. Imports are checked by
import-linter (pyproject.toml) and test_rust_layout.py."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
MOST_FILES = 14  # in a folder of sources
SOURCES = ".rs", ".py", ".md", ".toml", ".js", ".html", ".css"


def test_source_folders_have_few_files():
    roots = (
        "src",
        "cli",
        "crates",
        "examples",
        "tests",
        "benches",
        "python/liveview_ref",
        "python/tools",
        "python/tests",
    )
    folders = [folder for root in roots for folder in [ROOT / root, *(ROOT / root).rglob("*/")] if folder.is_dir()]
    skipped = {"target", "node_modules", "scenes", "seeds", "corpus", "artifacts", "__pycache__"}
    counts = {
        str(folder.relative_to(ROOT)): sum(path.suffix in SOURCES for path in folder.iterdir() if path.is_file())
        for folder in folders
        if not skipped & set(folder.relative_to(ROOT).parts)
    }
    assert counts and {name: count for name, count in counts.items() if count > MOST_FILES} == {}


def test_package_depends_on_what_make_setup_installs():
    folder = ROOT / "python"
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]

    def pins(*names: str) -> set[str]:
        lines = [line for name in names for line in (folder / f"{name}.txt").read_text().splitlines()]
        return {line for line in lines if line and not line.startswith(("#", "-"))}

    assert {*project["dependencies"], *extras["test"]} == pins("requirements", "requirements-runtime")
    assert set(extras["evaluation"]) == pins("requirements-evaluation")
