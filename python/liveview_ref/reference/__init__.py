"""The stages of the pipeline, a module each, named as in the Rust crate. Written to be read, in float32 and float64."""
