//! The layers of a frame, and what it reuses of the one before.

use super::layer_source::LayerSource;
use super::selection::Selection;
use crate::layers::Layers;
use crate::layers::guided::RangeMap;
#[cfg(feature = "surface")]
use crate::surface::TargetSurface;

/// What a frame reuses of the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reuse {
    /// Nothing: its layers are searched again.
    Nothing,
    /// All, whatever the photos show.
    All,
    /// All but what the photos contradict, which is searched again.
    Refreshed,
}

/// The layers of a frame.
pub(crate) struct FoundLayers {
    /// The layers, near → far.
    pub(crate) layers: Layers,
    /// Where they came from.
    pub(crate) source: LayerSource,
    /// How planes are selected from these once a frame is rendered on them.
    pub(crate) selection: Option<Selection>,
    /// The range of disparities of each cell, for guided layers.
    pub(crate) range: Option<RangeMap>,
    /// The surface and its per-view occlusion, for surface layers.
    #[cfg(feature = "surface")]
    pub(crate) surface: Option<TargetSurface>,
}

impl FoundLayers {
    /// Layers without anything else.
    pub(super) fn new(layers: Layers, source: LayerSource) -> Self {
        Self {
            layers,
            source,
            selection: None,
            range: None,
            #[cfg(feature = "surface")]
            surface: None,
        }
    }
}
