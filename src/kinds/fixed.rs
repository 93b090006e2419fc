//! Planes given beforehand: the same for every frame.

use super::frame_input::FrameInput;
use super::layer_kind::{Found, FoundLayers, LayerKind};
use super::layer_source::LayerSource;
use crate::layers::{Layers, LayersError};

/// The same layers for every frame.
pub(super) struct Fixed(pub(super) Layers);

impl LayerKind for Fixed {
    type Carried = ();

    fn first<E: From<LayersError>>(self, _: &mut FrameInput<'_, E>) -> Found<(), E> {
        Ok((FoundLayers::new(self.0, LayerSource::Fixed), None))
    }

    fn next<E: From<LayersError>>(self, (): (), frame: &mut FrameInput<'_, E>, _: bool) -> Found<(), E> {
        self.first(frame)
    }
}
