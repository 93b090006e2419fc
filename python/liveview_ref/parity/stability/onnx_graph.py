"""Modules as ONNX graphs in float32, run by onnxruntime."""

import io

import numpy as np
import onnxruntime
import torch
from torch import nn

from ...export import export_traced
from ...onnx_session import session

Arrays = tuple[np.ndarray, ...]


class Graph:
    """A module, traced with these inputs; `dynamic` axes of input0, input1, ... as in
    torch.onnx.export."""

    def __init__(self, module: nn.Module, inputs: Arrays, dynamic: dict):
        file, names = io.BytesIO(), [f"input{i}" for i in range(len(inputs))]
        tensors = tuple(torch.as_tensor(x) for x in inputs)
        export_traced(module, tensors, file, input_names=names, dynamic_axes=dynamic)
        self.session: onnxruntime.InferenceSession = session(file.getvalue(), 1)
        self.wanted = {node.name for node in self.session.get_inputs()}  # constant folding may have dropped some

    def __call__(self, *inputs: np.ndarray) -> list[np.ndarray]:
        feed = {f"input{i}": value for i, value in enumerate(inputs) if f"input{i}" in self.wanted}
        return self.session.run(None, feed)
