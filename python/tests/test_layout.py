"""The house itself: no module imports another in a circle, and the arrows between the folders point one way."""

import ast
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[1]
MAY_IMPORT = {  # folder: the folders that it may import from, beside itself and the modules at the root
    "reference": set(),
    "data": {"reference"},
    "evaluation": {"reference", "data"},
    "training": {"reference", "data", "evaluation"},
    "parity": {"reference"},
    "competitors": {"reference"},
    "paper": {"reference", "data", "evaluation", "training"},
}


def imports() -> dict[tuple[str, ...], set[tuple[str, ...]]]:
    """Modules of the package, as paths -> the modules they import, anywhere in the file."""
    files = {
        path.relative_to(ROOT).with_suffix("").parts: path
        for folder in ("liveview_ref", "tools")
        for path in (ROOT / folder).rglob("*.py")
    }
    found = {}
    for module, path in files.items():
        found[module] = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                base = module[: -node.level] if node.level else ()
                base += tuple(node.module.split(".")) if node.module else ()
                found[module] |= {m for m in [base, *((*base, alias.name) for alias in node.names)] if m in files}
    return found


def test_no_module_imports_itself_through_others():
    graph = imports()
    assert ("liveview_ref", "reference", "warp") in graph["liveview_ref", "reference", "render", "renderer"]
    tuple(TopologicalSorter(graph).static_order())  # CycleError names a circle


def test_folders_import_one_way():
    for module, imported in imports().items():
        if module[0] == "liveview_ref" and len(module) > 2:
            folders = {other[1] for other in imported if len(other) > 2} - {module[1]}
            assert folders <= MAY_IMPORT[module[1]], f"{'.'.join(module)} imports from {folders}"


def test_the_package_depends_on_what_make_setup_installs():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]

    def pins(*names: str) -> set[str]:
        lines = [line for name in names for line in (ROOT / f"{name}.txt").read_text().splitlines()]
        return {line for line in lines if line and not line.startswith(("#", "-"))}

    assert {*project["dependencies"], *extras["test"]} == pins("requirements", "requirements-runtime")
    assert set(extras["evaluation"]) == pins("requirements-evaluation")
