//! A rendered picture, for the summary and the record.

use std::path::PathBuf;

use crate::measure::Times;
use liveview::Shot;
use liveview::image::Score;

/// A picture that is rendered and written, or that an earlier run has written.
pub(super) struct Rendered {
    pub(super) shot: Shot,
    pub(super) layers: usize,
    /// `None` for a picture of an earlier run.
    pub(super) times: Option<Times>,
    pub(super) score: Option<Score>,
    /// Share of the picture that no view covers, 0 to 1.
    pub(super) uncovered_share: f64,
    /// Share of the pixels that are occluded in every view by the photos' own depth, 0 to 1.
    pub(super) occluded_share: f64,
    /// Mean share of the photos' depth that other photos confirm, 0 to 1; `None` for other layers than
    /// surface layers, and for a picture of an earlier run.
    pub(super) confirmed_share: Option<f64>,
    /// Share of the pixels on which the photos agree, 0 to 1; `None` with a network too.
    pub(super) agreeing_share: Option<f64>,
    /// Largest disparity, in 1/scene unit.
    pub(super) disparity_max: f32,
    pub(super) files: Vec<PathBuf>,
}
