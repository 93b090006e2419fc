"""The Rust crate against float64, float32 torch, kornia and onnxruntime: `python -m liveview_ref.parity` for every stage
of a render, `python -m liveview_ref.parity.stability` for stiff and extreme cases."""
