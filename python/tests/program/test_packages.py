"""The package's dependencies are what `make setup` installs."""

import tomllib

from liveview_ref.paths import ROOT


def test_package_depends_on_what_make_setup_installs():
    folder = ROOT / "python"
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]

    def pins(*names: str) -> set[str]:
        lines = [line for name in names for line in (folder / f"{name}.txt").read_text().splitlines()]
        return {line for line in lines if line and not line.startswith(("#", "-"))}

    assert {*project["dependencies"], *extras["test"]} == pins("requirements", "requirements-runtime")
    assert set(extras["evaluation"]) == pins("requirements-evaluation")
