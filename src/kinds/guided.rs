//! Guided layers: a first frame searches the target for a surface; the next one moves it with the
//! camera, and searches again where the photos contradict it.

use super::carried_surface::CarriedSurface;
use super::frame_input::FrameInput;
use super::layer_kind::{Found, FoundLayers, LayerKind};
use super::layer_source::LayerSource;
use super::target_views::TargetViews;
use crate::layers::guided::{GuidedSearch, RangeMap};
use crate::layers::{LayersError, padded};

/// Layers that divide the range of disparities of each cell.
pub(super) struct Guided {
    /// How many.
    pub(super) layers: usize,
    /// Planes of the first search; `None`: by the parallax.
    pub(super) coarse_planes: Option<usize>,
}

impl Guided {
    fn search<E>(&self, frame: &FrameInput<'_, E>) -> GuidedSearch {
        GuidedSearch { near: frame.near, far: frame.far, planes: self.coarse_planes }
    }

    fn layers(&self, range: RangeMap, source: LayerSource) -> Result<FoundLayers, LayersError> {
        let layers = range.layers(self.layers)?;
        Ok(FoundLayers { range: Some(range), ..FoundLayers::new(layers, source) })
    }
}

impl LayerKind for Guided {
    type Carried = CarriedSurface;

    fn first<E: From<LayersError>>(self, frame: &mut FrameInput<'_, E>) -> Found<CarriedSurface, E> {
        let views = TargetViews::new(frame.photos.sources(), frame.target);
        let sweeps = views.sweeps(frame.target);
        let stages = self.search(frame).search_levels(&views.levels, &sweeps, padded(frame.target.size()))?;
        let found = self.layers(stages.range.clone(), LayerSource::Searched)?;
        Ok((found, frame.is_followed.then(|| CarriedSurface::new(stages, &views))))
    }

    fn next<E: From<LayersError>>(
        self,
        carried: CarriedSurface,
        frame: &mut FrameInput<'_, E>,
        refresh: bool,
    ) -> Found<CarriedSurface, E> {
        if !carried.has_size_of(frame.target) {
            return self.first(frame);
        }
        let views = TargetViews::new(frame.photos.sources(), frame.target);
        let mut moved = carried.moved(frame.target);
        let refreshed = if refresh { moved.refresh(&self.search(frame), &views)? } else { 0.0 };
        let found = self.layers(moved.range(), LayerSource::propagated(refreshed))?;
        Ok((found, Some(moved)))
    }
}
