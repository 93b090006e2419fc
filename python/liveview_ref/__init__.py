"""LiveView in PyTorch: the reference of the Rust crate, and the training and evaluation
of its networks.

- `reference`: one module per stage, named as in the Rust crate, in float32 and float64
- `data`: posed photos, procedural scenes, training examples
- `training`: trains a network
- `evaluation`: scores a network on held-out photos, and baselines without one
- `parity`: every stage of the Rust crate against the reference; stiff and extreme cases
- `competitors`: other implementations of the pipeline, timed for a report of `liveview sweep`
- `paper`: the comparison with the paper's methods

Conventions, everywhere: OpenCV camera axes (x right, y down, z forward); `cam_from_world`: X_c =
R X_w + t; K in pixels; the centre of the pixel in column i, row j is (i + 0.5, j + 0.5);
disparity is 1/z, in 1 / scene unit; layers run from near to far; images are [3, H, W] RGB in
[0, 1] (sRGB values).
"""
