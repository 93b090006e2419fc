//! Layers along the surface that the depth of the photos gives. What a next frame reuses is that
//! depth, which belongs to the photos: it is searched again where a photo has changed.

use super::found_layers::FoundLayers;
use super::frame_input::{FrameInput, PhotosWithDepth};
use super::layer_source::LayerSource;
use crate::layers::LayersError;
use crate::surface::TargetSurface;

/// `count` layers along the target's surface.
pub(super) fn find(
    count: usize,
    frame: &FrameInput<'_>,
    photos: PhotosWithDepth<'_>,
) -> Result<FoundLayers, LayersError> {
    let PhotosWithDepth { maps, photos, rendered_from, searched } = photos;
    let (correction, searches_holes) = (frame.photo_correction, frame.searches_holes);
    let surface = TargetSurface::find(maps, &photos, rendered_from, frame.target, correction, searches_holes);
    let found = FoundLayers::new(surface.layers(count)?, LayerSource::propagated(searched));
    Ok(FoundLayers { surface: Some(surface), ..found })
}
