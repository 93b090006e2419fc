//! The views of a frame, as the guided search takes them.

use super::search::Levels;
use liveview::geometry::{Camera, PlaneSweep};
use liveview::warp::{NO_GAINS, SourceView};

/// The views of a frame, and the target that they are searched for.
pub(super) struct TargetViews<'a> {
    pub(super) levels: Levels<'a>,
    /// In the order of the levels' textures.
    cameras: Vec<&'a Camera>,
    pub(super) target: &'a Camera,
}

impl<'a> TargetViews<'a> {
    pub(super) fn new(sources: &[SourceView<'a>], target: &'a Camera) -> Self {
        let levels = Levels::new(sources.iter().map(|source| (source.texture, NO_GAINS)).collect());
        Self { levels, cameras: sources.iter().map(|source| source.camera).collect(), target }
    }

    /// Plane sweeps for a target, or for a part of one.
    pub(super) fn sweeps(&self, target: &Camera) -> Vec<PlaneSweep> {
        self.cameras.iter().map(|camera| PlaneSweep::new(camera, target)).collect()
    }
}
