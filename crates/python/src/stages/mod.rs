//! The stages of the pipeline on arrays, with the names and arguments of the Python reference
//! (`liveview_ref.reference`).

pub(crate) mod inner;
pub(crate) mod layers;
pub(crate) mod picture;
mod recorded;
pub(crate) mod render;
pub(crate) mod surface;
pub(crate) mod warp;
