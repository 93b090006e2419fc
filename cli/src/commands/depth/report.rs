//! The report on the depth of a photo.

use std::path::PathBuf;

use liveview::{DepthSource, ViewDepth};

use super::truth::Score;

/// The report on a photo's depth.
pub(super) struct Report {
    pub(super) name: String,
    pub(super) depth: ViewDepthSummary,
    pub(super) score: Option<Score>,
    pub(super) files: [PathBuf; 4],
}

/// A [`ViewDepth`] without its maps.
pub(super) struct ViewDepthSummary {
    pub(super) source: DepthSource,
    pub(super) seconds: f64,
    /// Share of the pixels that other photos confirm, 0 to 1.
    pub(super) confirmed: f64,
    /// Nearest and farthest confirmed depth, in scene units.
    pub(super) span: Option<(f64, f64)>,
    /// Disparity of one pixel of parallax, in 1/scene unit.
    pub(super) disparity_per_pixel: f32,
}

impl ViewDepthSummary {
    pub(super) fn of(depth: &ViewDepth) -> Self {
        let confirmed = || depth.confirmed.disparity.iter().copied().filter(|&disparity| disparity >= 0.0);
        let (low, high) =
            confirmed().fold((f32::INFINITY, 0.0_f32), |(low, high), value| (low.min(value), high.max(value)));
        let count = confirmed().count();
        Self {
            source: depth.source,
            seconds: depth.time.as_secs_f64(),
            confirmed: count as f64 / depth.confirmed.disparity.len() as f64,
            span: (count > 0).then(|| (1.0 / f64::from(high), 1.0 / f64::from(low))),
            disparity_per_pixel: depth.found.disparity_per_pixel,
        }
    }
}
