"""What tests share."""

import os

import pytest
import torch

from liveview_ref.paper.methods.liveview import liveview
from liveview_ref.paper.methods.method import Method

# Some virtual machines announce AMX and end a program that uses it, as bfloat16 convolutions do:
# AVX-512 at most. Read when the first of them is made, here and in the programs that tests start.
os.environ.setdefault("ONEDNN_MAX_CPU_ISA", "AVX10_1_512")


@pytest.fixture
def net() -> Method:
    torch.manual_seed(0)
    return liveview(4).eval()
