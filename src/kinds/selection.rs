//! The selection of planes from a frame that was rendered on all of them.

use crate::layers::{Layers, LayersError};
use crate::network::Alpha;
use crate::render::Frame;

/// A selection of planes, made once a frame has been rendered on all of them.
pub(crate) struct Selection {
    /// Planes kept.
    pub(super) keep: usize,
    /// Of all planes, 1/scene unit, near → far.
    pub(super) disparities: Vec<f64>,
}

impl Selection {
    /// The planes that a frame rendered on all of them selects, given how its layers share a pixel.
    pub(crate) fn planes(&self, frame: &Frame, alpha: Alpha) -> Result<Layers, LayersError> {
        let kept = alpha.select_planes(&frame.plane_histogram(self.disparities.len()), self.keep);
        let kept: Vec<f64> = kept.into_iter().map(|plane| self.disparities[plane]).collect();
        Layers::planes(&kept)
    }
}
