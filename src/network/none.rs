//! No network: every layer and every view as good as any other.

use ndarray::{ArrayView4, ArrayViewMut4};

use super::{NetworkError, PlaneNetwork};

/// Logits of 0: views are weighed by their distance alone, and layers that compete ([`super::Alpha::Competing`]) share a pixel evenly.
/// Along a surface that is what the network is to be compared with.
#[derive(Debug, Clone, Copy)]
pub struct NoNetwork {
    /// V.
    pub views: usize,
}

impl PlaneNetwork for NoNetwork {
    fn views(&self) -> usize {
        self.views
    }

    fn infer(&mut self, _: ArrayView4<'_, f32>, mut logits: ArrayViewMut4<'_, f32>) -> Result<(), NetworkError> {
        logits.fill(0.0);
        Ok(())
    }
}
