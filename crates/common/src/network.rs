//! What turns warped views into opacities and view weights: a model, or the views' agreement.

use anyhow::Result;
use liveview::LayerSpec;
use liveview::network::{NetworkError, NoNetwork, OrtNetwork, PlaneNetwork, RunEnd};
use ndarray::{ArrayView4, ArrayViewMut4};

/// The layers without a network: three along the surface, which soften its edges; how well views agree tells little between
/// layers that lie far apart.
pub const LAYERS_WITHOUT_NETWORK: LayerSpec = LayerSpec::Surface(3);

/// A model, or none.
#[derive(Debug)]
pub enum Network {
    /// A model in ONNX Runtime.
    Model(Box<OrtNetwork>),
    /// The views' agreement.
    None(NoNetwork),
}

impl Network {
    /// The layers that the model recommends; [`LAYERS_WITHOUT_NETWORK`] without one.
    pub fn recommended_layers(&self) -> Result<LayerSpec> {
        match self {
            Self::Model(network) => {
                network.recommended_layers().map_err(|error| anyhow::anyhow!("{error}; --layers decides instead"))
            }
            Self::None(_) => Ok(LAYERS_WITHOUT_NETWORK),
        }
    }

    /// A handle that ends the model's runs from another thread.
    pub fn run_end(&self) -> Option<RunEnd> {
        match self {
            Self::Model(network) => Some(network.run_end()),
            Self::None(_) => None,
        }
    }

    /// Whether planes can be selected by their opacities.
    pub fn tells_opacity(&self) -> bool {
        matches!(self, Self::Model(_))
    }
}

impl PlaneNetwork for Network {
    fn views(&self) -> usize {
        match self {
            Self::Model(network) => network.views(),
            Self::None(network) => network.views(),
        }
    }

    fn name(&self) -> String {
        match self {
            Self::Model(network) => network.name(),
            Self::None(network) => network.name(),
        }
    }

    fn infer(&mut self, hwv: ArrayView4<'_, f32>, logits: ArrayViewMut4<'_, f32>) -> Result<(), NetworkError> {
        match self {
            Self::Model(network) => network.infer(hwv, logits),
            Self::None(network) => network.infer(hwv, logits),
        }
    }
}
