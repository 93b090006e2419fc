//! Guided layers: a first frame searches the target for a surface; the next one moves it with the
//! camera, and searches again where the photos contradict it.

use super::carried_surface::CarriedSurface;
use super::found_layers::{FoundLayers, Reuse};
use super::frame_input::FrameInput;
use super::layer_source::LayerSource;
use super::target_views::TargetViews;
use crate::layers::guided::GuidedSearch;
use crate::layers::{LayersError, padded};

/// `count` layers that divide the range of disparities of each cell; `coarse_planes`: planes of the
/// first search, `None`: by the parallax.
pub(super) fn find(
    (count, coarse_planes): (usize, Option<usize>),
    carried: &mut Option<CarriedSurface>,
    frame: &FrameInput<'_>,
    reuse: Reuse,
) -> Result<FoundLayers, LayersError> {
    let search = GuidedSearch { near: frame.near, far: frame.far, planes: coarse_planes };
    let views = TargetViews::new(frame.sources, frame.target);
    // A surface can be carried over only to a target of the same size.
    let has_its_size = |before: &CarriedSurface| before.target.size() == frame.target.size();
    let before = carried.take().filter(|before| reuse != Reuse::Nothing && has_its_size(before));
    let (range, source) = if let Some(before) = before {
        let mut moved = before.moved(frame.target);
        let refreshed = if reuse == Reuse::Refreshed { moved.refresh(&search, &views)? } else { 0.0 };
        (carried.insert(moved).range(), LayerSource::propagated(refreshed))
    } else {
        let stages = search.search_levels(&views.levels, &views.sweeps(frame.target), padded(frame.target.size()))?;
        let range = stages.range.clone();
        *carried = frame.is_followed.then(|| CarriedSurface::new(stages, &views));
        (range, LayerSource::Searched)
    };
    let layers = range.layers(count)?;
    Ok(FoundLayers { range: Some(range), ..FoundLayers::new(layers, source) })
}
