"""The computation in plain torch, for float32 and float64. liveview.py is the paper; the other
files are what it does not have, with the names of the Rust crate."""
