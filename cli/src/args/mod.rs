//! Options that several commands share.

pub(crate) mod frame_rate;
pub(crate) mod layers;
pub(crate) mod model;
pub(crate) mod model_info;
pub(crate) mod model_names;
pub(crate) mod numbers;
pub(crate) mod output;
pub(crate) mod scene;
pub(crate) mod shard;
pub(crate) mod targets;
