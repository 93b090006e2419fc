"""Other implementations of the pipeline, which `liveview sweep --reference` times beside the Rust crate."""
