//! The layers of a shot, found as its [`crate::LayerSpec`] says.

use std::time::Duration;

use crate::kinds::{FoundLayers, LayerSource};
use crate::layers::Layers;
use crate::layers::guided::RangeMap;
#[cfg(feature = "surface")]
use crate::surface::TargetSurface;

/// The layers of a shot, and the time that finding them took.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Plan {
    /// The layers, near → far.
    pub layers: Layers,
    /// Wall time of the guided search, for guided layers; for surface layers of the surface, with
    /// the depth of photos that was unknown before.
    pub search: Duration,
    /// Wall time of the render that planes were selected from, for selected planes.
    pub selection: Duration,
    /// The range of disparities of each cell, for guided layers.
    pub range: Option<RangeMap>,
    /// The surface and its per-view occlusion, for surface layers.
    #[cfg(feature = "surface")]
    pub surface: Option<TargetSurface>,
}

impl Plan {
    /// A plan of layers that are known already.
    pub fn known(layers: Layers) -> Self {
        Self {
            layers,
            search: Duration::ZERO,
            selection: Duration::ZERO,
            range: None,
            #[cfg(feature = "surface")]
            surface: None,
        }
    }

    /// Layers that were found in that time.
    pub(super) fn found(found: FoundLayers, time: Duration) -> Self {
        Self {
            search: if found.source == LayerSource::Fixed { Duration::ZERO } else { time },
            range: found.range,
            #[cfg(feature = "surface")]
            surface: found.surface,
            ..Self::known(found.layers)
        }
    }
}
