//! Where the layers of a frame came from.

use std::fmt;

/// Where the layers of a frame came from.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum LayerSource {
    /// The same planes for every frame.
    Fixed,
    /// All planes, from which those of the next frames are selected.
    Dense,
    /// The planes that an earlier frame selected.
    Selected,
    /// A search over the whole target, or, for surface layers, over all photos used.
    Searched,
    /// The surface or the depth of an earlier frame, but for a share of the target (of the photos
    /// used, for surface layers) that was searched again.
    Propagated {
        /// That share, 0 to 1.
        refreshed: f64,
    },
}

impl LayerSource {
    /// Propagated but for this share, 0 to 1.
    pub(super) fn propagated(refreshed: f64) -> Self {
        if refreshed < 1.0 { Self::Propagated { refreshed } } else { Self::Searched }
    }
}

impl fmt::Display for LayerSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Fixed => "fixed",
            Self::Dense => "dense",
            Self::Selected => "selected",
            Self::Searched => "searched",
            Self::Propagated { refreshed: 0.0 } => "propagated",
            Self::Propagated { .. } => "refreshed",
        })
    }
}
