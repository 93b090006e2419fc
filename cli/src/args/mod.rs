//! Options that several commands share.

pub(crate) mod help;
pub(crate) mod layers;
pub(crate) mod model;
pub(crate) mod model_info;
pub(crate) mod numbers;
pub(crate) mod output;
pub(crate) mod scene;
