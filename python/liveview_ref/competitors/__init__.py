"""Other implementations of the pipeline, which are compared with the Rust crate."""
