//! Options that several commands share.

pub(crate) mod layers;
pub(crate) mod model;
pub(crate) mod model_info;
pub(crate) mod numbers;
pub(crate) mod output;
pub(crate) mod scene;

/// Help heading of the options that few people need; `-h` does not list them.
pub(crate) const ADVANCED: &str = "Advanced";
