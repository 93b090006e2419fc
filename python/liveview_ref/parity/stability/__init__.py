"""Stiff and extreme cases: every stage of the package liveview, float32 torch, kornia and
onnxruntime against float64, in one process."""
