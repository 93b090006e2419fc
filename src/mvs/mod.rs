//! The photos' own depth (multi-view stereo), and the target's surface from it.

mod aggregate;
mod consistency;
mod depth_maps;
mod disagreement;
mod exposure;
mod grid;
mod holes;
mod median;
mod photo_depth;
mod photo_sweep;
mod project;
mod splat;
mod surface;
#[cfg(test)]
mod tests;
mod visibility;

use ndarray::Array2;

pub use consistency::confirmed;
pub use depth_maps::DepthMaps;
pub use exposure::exposure_gains;
pub use photo_depth::{PhotoDepth, photo_depth};
pub use surface::{Surface, SurfaceView, surface};
pub use visibility::Visibility;
pub(crate) use visibility::WarpedLayer;

use crate::geometry::{Camera, PlaneSweep, Size};
use crate::layers::guided::{neighbourhood, parallax};
use crate::layers::{Layers, LayersError, padded};
use crate::warp::{RUN, RunCoverage, SamplePositions, SourceView, Texture, WarpSource, sample, whole};

/// Disparities of a photo that other photos confirm.
#[derive(Debug, Clone)]
pub struct KnownDepth {
    /// 1/scene unit, `[h, w]`; −1 where nothing confirms it.
    pub disparity: Array2<f32>,
}

impl KnownDepth {
    /// Of what a search found, what is confirmed.
    pub fn new(found: &PhotoDepth, confirmed: &Array2<bool>) -> Self {
        let keep = |&disparity: &f32, &confirmed: &bool| if confirmed { disparity } else { -1.0 };
        Self { disparity: ndarray::Zip::from(&found.disparity).and(confirmed).map_collect(keep) }
    }
}

/// What the search and the surface are tuned by. Lengths in px are pixels of parallax.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)]
pub struct Settings {
    pub neighbours: usize,
    pub extra: usize,
    pub further: usize,
    pub judges: usize,
    pub spacing: f64,
    pub radius: usize,
    pub fine_radius: usize,
    pub full: bool,
    pub parts: usize,
    pub step: f32,
    pub jump: f32,
    pub edge: f32,
    pub agree: f32,
    pub past: f32,
    pub hides: f32,
    pub second: bool,
    pub searched: bool,
    pub fuse: f32,
    pub votes: f32,
    pub refine: usize,
    pub refine_radius: usize,
    pub stay: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            neighbours: 4,
            extra: 2,
            further: 0,
            judges: 6,
            spacing: 1.0,
            radius: 0,
            fine_radius: 0,
            full: true,
            parts: 2,
            step: 0.01,
            jump: 0.12,
            edge: 0.05,
            agree: 2.0,
            past: 4.0,
            hides: 4.0,
            second: true,
            searched: true,
            fuse: 2.0,
            votes: 1.0,
            refine: 1,
            refine_radius: 1,
            stay: 2e-5,
        }
    }
}
