//! The depth of one photo: a plane sweep with the photo as reference among its neighbours.

pub(super) mod aggregate;
pub(super) mod anchors;
pub(super) mod cell_search;
pub(super) mod depth_map;
pub(super) mod detail;
pub(super) mod grid;
mod path;
pub(super) mod penalties;
pub(super) mod photo_depth;
pub(super) mod photo_sweep;
pub(super) mod planes;
mod tile;
pub(super) mod tile_ranges;

pub use depth_map::PhotoDepth;
pub use photo_depth::photo_depth;
