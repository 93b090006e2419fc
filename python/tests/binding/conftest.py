"""The package liveview, from the wheel that `make wheel` builds."""

import sys
import zipfile
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from liveview_ref.paths import ROOT

WORKSHOP = ROOT / "tests" / "scenes" / "workshop"


@pytest.fixture(scope="session")
def wheel() -> Path:
    wheels = sorted((ROOT / "target/wheels").glob("liveview-*.whl"), key=lambda path: path.stat().st_mtime)
    if not wheels:
        pytest.skip("the wheel is not built (make wheel)")
    return wheels[-1]


@pytest.fixture(scope="session")
def liveview(wheel, tmp_path_factory) -> ModuleType:
    folder = tmp_path_factory.mktemp("wheel")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    sys.path.insert(0, str(folder))
    import liveview

    assert Path(liveview.__file__).is_relative_to(folder)
    return liveview


@pytest.fixture(scope="session")
def inner(liveview) -> ModuleType:
    """The stages inside those of the package."""
    return liveview._stages


@pytest.fixture(scope="session")
def workshop(liveview):
    """The example scene from its folder, a third of its size."""
    return liveview.Scene(WORKSHOP, width=168)


@pytest.fixture(scope="session")
def arrays(workshop) -> dict[str, np.ndarray]:
    """The same scene as arrays."""
    return {
        "photos": np.stack([workshop.photo(name) for name in workshop.names]),
        "k": np.stack([camera.k for camera in workshop.cameras]),
        "poses": np.stack([camera.pose() for camera in workshop.cameras]),
    }
