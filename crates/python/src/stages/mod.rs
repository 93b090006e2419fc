//! The stages of the pipeline on arrays, with the names and arguments of the Python reference
//! (`liveview_ref.reference`).

pub(crate) mod depth;
pub(crate) mod fusion;
pub(crate) mod layers;
pub(crate) mod metrics;
pub(crate) mod network;
mod photo;
pub(crate) mod picture;
mod recorded;
pub(crate) mod render;
pub(crate) mod search;
pub(crate) mod surface;
pub(crate) mod views;
pub(crate) mod warp;
