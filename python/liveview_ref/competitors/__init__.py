"""Other implementations of the pipeline, which `liveview sweep --reference` compares with
the Rust crate."""
