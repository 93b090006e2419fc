//! Layers along the surface that the depth of the photos gives. What a next frame reuses is that
//! depth, which belongs to the photos: it is searched again where a photo has changed.

use super::frame_input::{DepthUpdate, FrameInput, PhotosWithDepth};
use super::layer_kind::{Found, FoundLayers, LayerKind};
use super::layer_source::LayerSource;
use crate::layers::LayersError;
use crate::surface::TargetSurface;

/// Layers along the target's surface.
pub(super) struct AlongSurface {
    /// How many.
    pub(super) count: usize,
}

impl AlongSurface {
    fn along<E: From<LayersError>>(self, frame: &mut FrameInput<'_, E>, update: DepthUpdate) -> Found<(), E> {
        let PhotosWithDepth { maps, photos, rendered_from, searched } = frame.photos.with_depth(update)?;
        let (correction, searches_holes) = (frame.photo_correction, frame.searches_holes);
        let surface = TargetSurface::find(maps, &photos, rendered_from, frame.target, correction, searches_holes);
        let layers = surface.layers(self.count)?;
        let found = FoundLayers::new(layers, LayerSource::propagated(searched));
        Ok((FoundLayers { surface: Some(surface), ..found }, Some(())))
    }
}

impl LayerKind for AlongSurface {
    type Carried = ();

    fn first<E: From<LayersError>>(self, frame: &mut FrameInput<'_, E>) -> Found<(), E> {
        self.along(frame, DepthUpdate::All)
    }

    fn next<E: From<LayersError>>(self, (): (), frame: &mut FrameInput<'_, E>, refresh: bool) -> Found<(), E> {
        self.along(frame, if refresh { DepthUpdate::Changed } else { DepthUpdate::Nothing })
    }
}
