//! The paper's selection: a first frame is rendered on all planes, the next ones on those that it
//! selects ([`Alpha::select_planes`]).

use super::frame_input::FrameInput;
use super::layer_kind::{FoundLayers, LayerKind};
use super::layer_source::LayerSource;
use crate::layers::{Layers, LayersError, uniform_disparities};
use crate::network::Alpha;
use crate::render::Frame;

/// Planes selected from uniform ones.
pub(super) struct Selected {
    /// Planes kept.
    pub(super) keep: usize,
    /// Planes that they are selected from.
    pub(super) from: usize,
}

/// A selection that waits for a frame rendered on all planes.
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

impl LayerKind for Selected {
    type Carried = Layers;

    fn first<E: From<LayersError>>(self, frame: &mut FrameInput<'_, E>) -> Result<(FoundLayers, Option<Layers>), E> {
        let disparities = uniform_disparities(frame.near, frame.far, self.from)?;
        let layers = Layers::planes(&disparities)?;
        let selection = Some(Selection { keep: self.keep, disparities });
        Ok((FoundLayers { selection, ..FoundLayers::new(layers, LayerSource::Dense) }, None))
    }

    fn next<E: From<LayersError>>(
        self,
        carried: Layers,
        _: &mut FrameInput<'_, E>,
        _: bool,
    ) -> Result<(FoundLayers, Option<Layers>), E> {
        Ok((FoundLayers::new(carried.clone(), LayerSource::Selected), Some(carried)))
    }
}
