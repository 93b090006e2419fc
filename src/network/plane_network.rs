//! The interface between the pipeline and a network.

use ndarray::{ArrayView4, ArrayViewMut4};

use super::alpha::Alpha;
use super::error::NetworkError;
use super::run_end::RunEnd;
use crate::layers::LayerSpec;

/// Computes the logits of a batch of layers, each layer alone (paper, section "Neural Network").
pub trait PlaneNetwork: Send {
    /// V, the number of views in its input.
    fn views(&self) -> usize;

    /// `hwv` `[n, 3V, h, w]` (views nearest first, RGB in [0, 1], zeros outside the photos; h and w
    /// are multiples of [`crate::layers::STRIDE`]) → `logits` `[n, V, h, w]`, both in standard
    /// layout.
    ///
    /// # Errors
    ///
    /// [`NetworkError`] if the network cannot be run.
    fn infer(&mut self, hwv: ArrayView4<'_, f32>, logits: ArrayViewMut4<'_, f32>) -> Result<(), NetworkError>;

    /// Its name in messages: the path of its file, if it has one.
    fn name(&self) -> String {
        "the network".to_owned()
    }

    /// The layers to render on where the caller names none.
    ///
    /// # Errors
    ///
    /// [`NetworkError::Unfit`] if its model file recommends something that is not a [`LayerSpec`].
    fn recommended_layers(&self) -> Result<LayerSpec, NetworkError> {
        Ok(LayerSpec::guided(2))
    }

    /// How the layers of a pixel share it: independently, as in the paper, unless its logits are
    /// made for something else.
    fn alpha(&self) -> Alpha {
        Alpha::Independent
    }

    /// Whether logit 0 is the opacity of a layer, so that planes can be selected by it
    /// ([`LayerSpec::Select`]).
    fn predicts_opacity(&self) -> bool {
        true
    }

    /// A handle that ends its runs from another thread, if they can be ended.
    fn run_end(&self) -> Option<RunEnd> {
        None
    }
}
