//! Warp: bilinear sampling of the views along a layer, directly into the batch that the network
//! reads (paper, section "HWV").
//!
//! A sample is valid iff w > 0 ([`crate::geometry::PlaneSweep`]) and its bilinear footprint touches
//! the image; zeros outside (torch's `grid_sample(mode="bilinear", padding_mode="zeros",
//! align_corners=False)`). Coordinates that are not finite are outside. Beside the colour each
//! sample has a **coverage** in [0, 1]: the same sample of an all-ones image.

mod bilinear;
mod layer_band;
mod own_depth;
mod rounding;
mod run;
mod run_middle;
mod sample_positions;
mod source;
mod texture;
mod volume;

#[cfg(feature = "surface")]
pub(crate) use bilinear::sample;
pub(crate) use layer_band::LayerBand;
pub(crate) use own_depth::OwnDepth;
#[cfg(feature = "surface")]
pub(crate) use rounding::round_to_i32;
pub(crate) use run::{ALL_SEEN, RUN, RunCoverage};
#[cfg(feature = "surface")]
pub(crate) use sample_positions::SamplePositions;
pub use source::{NO_GAINS, SourceView, WarpSource, warp_sources};
pub use texture::Texture;
pub use volume::warp_layers;
pub(crate) use volume::{WarpedLayers, run_coverage_len, warp_layers_into};
