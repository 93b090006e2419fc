//! The paper's selection: a first frame is rendered on all planes; the next ones reuse those that it
//! selects (`find_layers`).

use super::found_layers::FoundLayers;
use super::layer_source::LayerSource;
use super::selection::Selection;
use crate::layers::{Layers, LayersError, uniform_disparities};

/// All planes, of which a frame that is rendered on them selects some.
pub(super) fn all_planes(near: f64, far: f64, from: usize, keep: usize) -> Result<FoundLayers, LayersError> {
    let disparities = uniform_disparities(near, far, from)?;
    let layers = Layers::planes(&disparities)?;
    let selection = Some(Selection { keep, disparities });
    Ok(FoundLayers { selection, ..FoundLayers::new(layers, LayerSource::Dense) })
}
