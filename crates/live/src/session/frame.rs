//! A rendered time step.

use std::time::Duration;

use liveview::render::{Frame, StageTimes};
use liveview_synthesizer::LayerSource;

/// A rendered time step.
#[derive(Debug, Clone)]
pub struct LiveFrame {
    /// The picture, with its depth.
    pub frame: Frame,
    /// Where its layers came from.
    pub layer_source: LayerSource,
    /// Indices of the cameras it was rendered from, nearest first.
    pub views: Vec<usize>,
    /// Wall time per stage.
    pub times: LiveTimes,
}

/// Wall time per stage of one time step.
#[derive(Debug, Clone, Copy, Default)]
pub struct LiveTimes {
    /// Converting the photos to textures.
    pub photos: Duration,
    /// Finding the layers.
    pub layers: Duration,
    /// Rendering them.
    pub stages: StageTimes,
}

impl LiveTimes {
    /// The sum of all stages.
    pub fn total(&self) -> Duration {
        self.photos + self.layers + self.stages.warp + self.stages.network + self.stages.composite
    }
}
