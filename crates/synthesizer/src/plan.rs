//! The layers of a shot, found as its [`crate::LayerSpec`] says.

use std::time::Duration;

use liveview::layers::Layers;
use liveview::render::ViewCorrection;
use liveview_surface::TargetSurface;
use liveview_surface::guided::RangeMap;

use crate::find_layers::{FoundLayers, LayerSource};

/// The layers of a shot, and the time that finding them took.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Plan {
    /// The layers, near → far.
    pub layers: Layers,
    /// Wall time of the guided search, for guided layers; for others of the surface and the photos'
    /// correction, with the depth of photos that was unknown before.
    pub search: Duration,
    /// Wall time of the render that planes were selected from, for selected planes.
    pub selection: Duration,
    /// The range of disparities of each cell, for guided layers.
    pub range: Option<RangeMap>,
    /// Correction of the views' photos; empty: they are used as they are.
    pub corrections: Vec<ViewCorrection>,
    /// The surface and its per-view occlusion, for surface layers.
    pub surface: Option<TargetSurface>,
}

impl Plan {
    /// A plan of layers that are known already, with the photos as they are.
    pub fn known(layers: Layers) -> Self {
        Self {
            layers,
            search: Duration::ZERO,
            selection: Duration::ZERO,
            range: None,
            corrections: Vec::new(),
            surface: None,
        }
    }

    /// Layers that were found in that time.
    pub(super) fn found(found: FoundLayers, time: Duration) -> Self {
        Self {
            search: if found.source == LayerSource::Fixed { Duration::ZERO } else { time },
            range: found.range,
            corrections: found.surface.as_ref().map_or_else(Vec::new, |surface| surface.corrections().to_vec()),
            surface: found.surface,
            ..Self::known(found.layers)
        }
    }
}
