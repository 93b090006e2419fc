"""LiveView reference: the pipeline of the Rust crate in plain PyTorch, one module per stage, in float32 and float64.

Conventions, everywhere: OpenCV camera axes (x right, y down, z forward); `cam_from_world`: X_c = R X_w + t;
K in pixels; the centre of the pixel in column i, row j is (i + 0.5, j + 0.5); layers run from near to far;
images are [3, H, W] RGB in [0, 1] (sRGB values).
"""
