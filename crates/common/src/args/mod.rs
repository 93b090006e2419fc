//! Options that several commands share.

/// Help heading of the options that few people need; `-h` does not list them.
pub const ADVANCED: &str = "Advanced";

pub mod frame_rate;
pub mod layers;
pub mod model;
pub mod model_info;
pub mod model_names;
pub mod numbers;
pub mod output;
pub mod scene;
pub mod targets;
