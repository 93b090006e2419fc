"""The stages of the pipeline in plain torch, for float32 and float64. Folders, files and names are
those of the Rust crate.

Start with unet.py (the network), warp.py (photos onto layers) and composite.py (layers
into a picture)."""
