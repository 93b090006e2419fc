"""Exported models, run by onnxruntime in Python. Without torch, whose memory would count in a
competitor's process."""

from pathlib import Path

import numpy as np
import onnxruntime


def session(model: Path | bytes, threads: int = 0) -> onnxruntime.InferenceSession:
    """A session on the CPU with this number of threads (0: one per core), which sleep when idle."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def logits(network: onnxruntime.InferenceSession, hwv: np.ndarray, batch: int | None = None) -> np.ndarray:
    """Logits [n, V, h, w] of an HWV [n, 3V, h, w], `batch` layers at a time (None: all)."""
    batch = batch or len(hwv)
    parts = [hwv[first : first + batch] for first in range(0, len(hwv), batch)]
    return np.concatenate([network.run(["logits"], {"hwv": part})[0] for part in parts])
