"""What tests share."""

import pytest
import torch

from liveview_ref.paper.method import Method
from liveview_ref.paper.methods.liveview import liveview


@pytest.fixture
def net() -> Method:
    torch.manual_seed(0)
    return liveview(4).eval()
