//! Surface layers: the depth of the photos (multi-view stereo), and the target's surface from it.
//!
//! ```text
//! photo, neighbours ─► search ─► edges, confirmed by other photos ─┐ (DepthMaps: search once per photo,
//!                                                                  ├─► TargetSurface ─► layers, visibility ─► Renderer
//!                                                         target ──┘   edges once per set of photos)
//! ```
//!
//! - `search`: the depth of one photo, by a plane sweep with the photo as reference.
//! - `anchored_depth`: the same, with what the neighbours find as anchors.
//! - `fusion`: consistency between photos, their depth at edges, and its fusion at the target.
//! - `correction`: exposure and sharpness of the photos.
//! - `range`: the depth range of a scene that gives none.
//! - `cache`: the depth of photos as files.
//!
//! Soft3D (Penner and Zhang, 2017) and multi-view stereo systems (COLMAP; Free View Synthesis,
//! 2020) search depth at a reference image. Each file states its formulas, constants and ties; the
//! result has the same bits on any number of threads.

mod anchored_depth;
pub(crate) mod cache;
mod correction;
mod depth_maps;
mod found_range;
mod fusion;
mod kept_votes;
mod neighbourhood;
mod range;
mod search;
mod small_maps;
#[doc(hidden)] // for crates/python, whose parity tests compare them with the reference
pub mod stages;
mod target_surface;
#[cfg(test)]
mod tests;

pub use anchored_depth::anchored_depth;
pub(crate) use anchored_depth::{anchored_depth_in_scene, small_photo};
pub use correction::{exposure_gains, sharpening};
pub(crate) use depth_maps::Comparison;
pub use depth_maps::{DepthMaps, EXTRA_PHOTOS, NEIGHBOURS};
pub(crate) use found_range::found_range;
pub use fusion::{ConfirmedDepth, ConsistencyVotes, Surface, SurfaceView, confirmed, surface};
pub(crate) use kept_votes::Votes;
pub use search::{PhotoDepth, photo_depth};
pub(crate) use small_maps::SmallMaps;
pub use target_surface::{PhotoCorrection, TargetSurface};
