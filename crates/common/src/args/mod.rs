//! Options that several commands share.

pub mod frame_rate;
pub mod help;
pub mod layers;
pub mod model;
pub mod model_info;
pub mod model_names;
pub mod numbers;
pub mod output;
pub mod scene;
pub mod targets;
