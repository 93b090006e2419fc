"""The Rust crate against float64, float32 torch, kornia and onnxruntime: every stage of a render
(`python -m liveview_ref.parity`), and stiff and extreme cases
(`python -m liveview_ref.parity.stability`)."""
