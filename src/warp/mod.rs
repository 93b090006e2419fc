//! Warp: bilinear sampling of the views along a layer, directly into the batch that the network
//! reads (paper, section "HWV").
//!
//! A sample is valid iff w > 0 ([`crate::geometry::PlaneSweep`]) and its bilinear footprint touches
//! the image; zeros outside (torch's `grid_sample(mode="bilinear", padding_mode="zeros",
//! align_corners=False)`). Coordinates that are not finite are outside. Beside the colour each
//! sample has a **coverage** in [0, 1]: the same sample of an all-ones image.

mod bilinear;
mod layer_band;
mod run;
mod sample_positions;
mod texture;
mod volume;

pub use bilinear::sample;
pub(crate) use layer_band::{LayerBand, OwnDisparity};
pub(crate) use run::{ALL_SEEN, clamp};
pub use run::{RUN, RunCoverage, round_to_i32};
pub use sample_positions::SamplePositions;
pub use texture::Texture;
pub use volume::warp_layers;
pub(crate) use volume::{WarpedLayers, run_coverage_len, warp_layers_into};

use crate::geometry::{Camera, PlaneSweep};

/// A view: its camera and its photo.
#[derive(Debug, Clone, Copy)]
pub struct SourceView<'a> {
    /// Its camera, for an image of the texture's size.
    pub camera: &'a Camera,
    /// Its photo.
    pub texture: &'a Texture,
}

/// A view with its plane sweep for one target.
#[derive(Debug, Clone, Copy)]
pub struct WarpSource<'a> {
    /// Its photo.
    pub texture: &'a Texture,
    /// Its sweep over the target's disparities.
    pub sweep: PlaneSweep,
    /// Factor of each colour channel of its samples.
    pub gains: [f32; 3],
}

impl<'a> WarpSource<'a> {
    /// A photo with unchanged colours.
    pub fn new(texture: &'a Texture, sweep: PlaneSweep) -> Self {
        Self { texture, sweep, gains: NO_GAINS }
    }
}

/// Gains that change nothing.
pub const NO_GAINS: [f32; 3] = [1.0; 3];

/// The views' textures, with their plane sweeps for `target`.
pub fn warp_sources<'a>(views: &[SourceView<'a>], target: &Camera) -> Vec<WarpSource<'a>> {
    views.iter().map(|v| WarpSource::new(v.texture, PlaneSweep::new(v.camera, target))).collect()
}
