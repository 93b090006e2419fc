//! The photos' own depth (multi-view stereo), and the target's surface from it: sharp edges, and views that speak only where they see.
//!
//! ```text
//! photo, neighbours ─► photo_depth ─► confirmed ─┐ (once per photo: DepthMaps)
//!                                                ├─► surface ─► layers, visibility ─► Renderer::render_visible
//!                                     target ────┘
//! ```
//!
//! Soft3D (Penner and Zhang, 2017) and multi-view-stereo systems (COLMAP; Free View Synthesis, 2020) search depth where there is a
//! reference image. Each file says its formulas, constants and ties; all of it gives the same bits on any number of threads.

mod aggregate;
pub(crate) mod cache;
mod consistency;
mod correspondences;
mod depth_maps;
mod disagreement;
mod exposure;
mod extremes;
mod grid;
mod holes;
mod median;
mod pair_statistics;
mod penalties;
mod photo_depth;
mod photo_sweep;
mod planes;
mod project;
mod seen_surface;
mod sharpened;
mod sharpness;
mod splat;
pub mod stages;
mod surface;
#[cfg(test)]
mod tests;
mod tile;
mod visibility;

use ndarray::Array2;

pub use consistency::{Opinion, confirmed};
pub use depth_maps::DepthMaps;
pub use exposure::exposure_gains;
pub use photo_depth::{PhotoDepth, photo_depth};
pub use seen_surface::{Matched, SeenSurface};
pub(crate) use sharpened::SharpenedPhotos;
pub use sharpness::sharpening;
pub use surface::{Surface, SurfaceView, surface};
pub(crate) use visibility::hide;
pub use visibility::{Visibility, VisibleView};

use crate::geometry::{Camera, PlaneSweep, Size};
use crate::layers::guided::parallax;
use crate::layers::{Layers, LayersError, padded};
use crate::warp::{RUN, RunCoverage, SamplePositions, SourceView, Texture, WarpSource, sample, whole};

/// Disparities of a photo that other photos confirm.
#[derive(Debug, Clone)]
pub struct KnownDepth {
    /// 1/scene unit, `[h, w]`; −1 where nothing confirms it.
    pub disparity: Array2<f32>,
    /// Disparity that is worth one pixel of parallax ([`PhotoDepth::pixel`]).
    pub pixel: f32,
}

impl KnownDepth {
    /// Of what a search found, what is confirmed.
    pub fn new(found: &PhotoDepth, confirmed: &Array2<bool>) -> Self {
        let keep = |&disparity: &f32, &confirmed: &bool| if confirmed { disparity } else { -1.0 };
        let disparity = ndarray::Zip::from(&found.disparity).and(confirmed).map_collect(keep);
        Self { disparity, pixel: found.pixel }
    }
}

/// What the search and the surface are tuned by. Lengths in px are pixels of parallax.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Settings {
    /// Photos that one is matched with.
    pub neighbours: usize,
    /// Photos beyond the V of the picture that its surface is found with.
    pub extra: usize,
    /// Distance of the planes of the first search, px.
    pub spacing: f64,
    /// Planes of the second search for one of the first.
    pub parts: usize,
    /// Penalty of a step to the next plane.
    pub step: f32,
    /// Penalty of a jump to any other, where the photo has no edge.
    pub jump: f32,
    /// Difference of colour that halves the latter.
    pub edge: f32,
    /// Within how many px another map confirms a depth, and two depths carried to the target are one surface.
    pub agree: f32,
    /// From how many px on another map contradicts it.
    pub past: f32,
    /// How many px behind another depth one may lie that is averaged with it where both are carried to the target.
    pub fuse: f32,
    /// Share of the target's pixels without a confirmed depth from which on they are searched at the target as well.
    pub search_holes: f64,
    /// How much nearer a view's own depth must be to hide a point, px.
    pub hides: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            neighbours: 5,
            extra: 2,
            spacing: 1.0,
            parts: 2,
            step: 0.01,
            jump: 0.12,
            edge: 0.05,
            agree: 2.0,
            past: 4.0,
            fuse: 3.0,
            search_holes: 0.05,
            hides: 4.0,
        }
    }
}
