//! The seam between the pipeline and a network.

use ndarray::{ArrayView4, ArrayViewMut4};

use super::error::NetworkError;

/// Computes the logits of a batch of layers, each layer alone (paper, section "Neural Network").
pub trait PlaneNetwork {
    /// V, the number of views in its input.
    fn views(&self) -> usize;

    /// What to call it in messages: its file, if it comes from one.
    fn name(&self) -> String {
        "the network".to_owned()
    }

    /// `hwv` `[n, 3V, h, w]` (views nearest first, RGB in [0, 1], zeros outside the photos; h and w are multiples of
    /// [`crate::layers::STRIDE`]) → `logits` `[n, V, h, w]`, both in standard layout.
    ///
    /// # Errors
    ///
    /// [`NetworkError`] if the network cannot be run.
    fn infer(&mut self, hwv: ArrayView4<'_, f32>, logits: ArrayViewMut4<'_, f32>) -> Result<(), NetworkError>;
}
