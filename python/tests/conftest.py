"""Shared fixtures."""

import os

import pytest
import torch

from liveview_ref.paper.methods.liveview import liveview
from liveview_ref.paper.methods.method import Method

# Some virtual machines announce AMX but kill a program that uses it (as bfloat16 convolutions do).
# Limits oneDNN to AVX-512, in this process and in programs that tests start.
os.environ.setdefault("ONEDNN_MAX_CPU_ISA", "AVX10_1_512")


@pytest.fixture
def net() -> Method:
    torch.manual_seed(0)
    return liveview(4).eval()
