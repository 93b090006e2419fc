"""The package liveview, from the wheel that `make wheel` builds."""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from liveview_ref.paths import ROOT

WORKSHOP = ROOT / "tests" / "scenes" / "workshop"


@pytest.fixture(scope="session")
def wheel() -> Path:
    return pytest.importorskip("liveview_ref.extension", exc_type=ImportError).WHEELS[-1]


@pytest.fixture(scope="session")
def liveview() -> ModuleType:
    return pytest.importorskip("liveview_ref.extension", exc_type=ImportError).liveview


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
