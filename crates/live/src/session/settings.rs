//! How a session renders.

use super::policy::Policy;
use liveview_synthesizer::LayerSpec;

/// How a session renders.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveSettings {
    /// Nearest depth, scene units.
    pub near: f64,
    /// Farthest depth, scene units; may be infinite.
    pub far: f64,
    /// Which layers each frame is rendered on.
    pub layers: LayerSpec,
    /// When these are searched for.
    pub policy: Policy,
    /// Whether surface layers leave the exposure of the photos unchanged; by default it is
    /// balanced.
    pub keep_exposure: bool,
}

impl LiveSettings {
    /// Two guided layers, the surface propagated from frame to frame.
    pub fn new(near: f64, far: f64) -> Self {
        let layers = LayerSpec::guided(2);
        Self { near, far, policy: Policy::default_for(&layers), layers, keep_exposure: false }
    }
}
