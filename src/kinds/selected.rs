//! The paper's selection: a first frame is rendered on all planes, the next ones on those that it
//! selects.

use super::frame_input::FrameInput;
use super::layer_kind::{Found, FoundLayers, LayerKind};
use super::layer_source::LayerSource;
use super::selection::Selection;
use crate::layers::{Layers, LayersError, uniform_disparities};

/// Planes selected from uniform ones.
pub(super) struct Selected {
    /// Planes kept.
    pub(super) keep: usize,
    /// Planes that they are selected from.
    pub(super) from: usize,
}

impl LayerKind for Selected {
    type Carried = Layers;

    fn first<E: From<LayersError>>(self, frame: &mut FrameInput<'_, E>) -> Found<Layers, E> {
        let disparities = uniform_disparities(frame.near, frame.far, self.from)?;
        let layers = Layers::planes(&disparities)?;
        let selection = Some(Selection { keep: self.keep, disparities });
        Ok((FoundLayers { selection, ..FoundLayers::new(layers, LayerSource::Dense) }, None))
    }

    fn next<E: From<LayersError>>(self, carried: Layers, _: &mut FrameInput<'_, E>, _: bool) -> Found<Layers, E> {
        Ok((FoundLayers::new(carried.clone(), LayerSource::Selected), Some(carried)))
    }
}
