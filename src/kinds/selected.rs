//! The paper's selection: a first frame is rendered on all planes, the next ones on those that it
//! selects.

use super::found_layers::FoundLayers;
use super::layer_source::LayerSource;
use crate::layers::{Layers, LayersError, uniform_disparities};
use crate::network::Alpha;
use crate::render::Frame;

/// All planes, of which a frame that is rendered on them selects some.
pub(super) fn all_planes(near: f64, far: f64, from: usize, keep: usize) -> Result<FoundLayers, LayersError> {
    let disparities = uniform_disparities(near, far, from)?;
    let layers = Layers::planes(&disparities)?;
    let selection = Some(Selection { keep, disparities });
    Ok(FoundLayers { selection, ..FoundLayers::new(layers, LayerSource::Dense) })
}

/// A selection of planes, made once a frame has been rendered on all of them.
pub(crate) struct Selection {
    /// Planes kept.
    keep: usize,
    /// Of all planes, 1/scene unit, near → far.
    disparities: Vec<f64>,
}

impl Selection {
    /// The planes that a frame rendered on all of them selects, given how its layers share a pixel.
    pub(crate) fn planes(&self, frame: &Frame, alpha: Alpha) -> Result<Layers, LayersError> {
        let kept = alpha.select_planes(&frame.plane_histogram(self.disparities.len()), self.keep);
        let kept: Vec<f64> = kept.into_iter().map(|plane| self.disparities[plane]).collect();
        Layers::planes(&kept)
    }
}
