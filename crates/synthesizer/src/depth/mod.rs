//! The depth of a scene's photos: each is searched when it is first needed, kept in memory, and in
//! files if a folder for them is given.

pub(super) mod depth_search;
pub(super) mod depth_store;
mod photo_depths;
pub(super) mod scene_depth;
