//! Surface layers: the depth of the photos (multi-view stereo), and the target's surface from it.
//!
//! ```text
//! photo, neighbours ─► search ─► edges, confirmed by other photos ─┐ (DepthMaps: search once per photo,
//!                                                                  ├─► TargetSurface ─► layers, visibility ─► Renderer
//!                                                         target ──┘   edges once per set of photos)
//! ```
//!
//! - `photo_depth`, `photo_sweep`, `aggregate`, `grid`: the depth of one photo, by a plane sweep with the
//!   photo as reference.
//! - `anchored_depth`: the same, with what the neighbours find as anchors.
//! - `consistency`, `nearer_edges`: what photos confirm of each other's depth, and depth at edges.
//! - `followed_depth`: the depth of photos that change from time step to time step.
//! - `fusion`, `target_search`: the surface of a target, and the search of its holes.
//! - `correction`: exposure and sharpness of the photos.
//! - `depth_range`: the depth range of a scene that gives none.
//! - [`guided`], `carried_surface`: a coarser search at the target alone, for guided layers.
//! - [`cache`]: the depth of photos as files.
//!
//! Soft3D (Penner and Zhang, 2017) and multi-view stereo systems (COLMAP; Free View Synthesis,
//! 2020) search depth at a reference image. Each file states its formulas, constants and ties; the
//! result has the same bits on any number of threads.

mod aggregate;
mod anchored_depth;
pub mod cache;
mod carried_surface;
mod consistency;
mod correction;
mod depth_maps;
mod depth_range;
mod followed_depth;
mod fusion;
mod grid;
pub mod guided;
mod matching;
mod nearer_edges;
mod neighbourhood;
pub mod parallax;
mod photo_depth;
mod photo_sweep;
#[doc(hidden)] // for the parity tests
pub mod stages;
mod target_search;
mod target_surface;
#[cfg(test)]
mod tests;

pub use anchored_depth::{SmallMaps, SmallPhoto, anchored_depth_in_scene};
pub use consistency::{ConfirmedDisparity, ConsistencyVotes};
pub use depth_maps::{DepthMaps, EXTRA_PHOTOS, NEIGHBOURS};
pub use depth_range::depth_range;
pub use followed_depth::{FollowedDepth, StepPhoto};
pub use fusion::Surface;
pub use photo_depth::{PhotoDisparity, photo_depth, search_bytes};
pub use target_surface::{PhotoCorrection, TargetSurface, photo_corrections};

/// What a frame reuses of the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reuse {
    /// Nothing: its layers are searched again.
    Nothing,
    /// All, whatever the photos show.
    All,
    /// All but what the photos contradict, which is searched again.
    Refreshed,
}
