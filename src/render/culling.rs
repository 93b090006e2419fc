//! Layers that need not be rendered: each is left out only where the error is zero or bounded.
//!
//! Along a target ray the weights T α of a layer and of all behind it sum to at most the T in front of it. So with colours in
//! [0, 1], leaving out layers where T is below τ changes no channel of a pixel by more than τ, whatever their α.

use super::composite_row::CompositeRow;
use crate::geometry::Size;

/// When a layer may be left out.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Culling {
    /// Leave out a layer that no view covers at any pixel of the target. Exact: its α is 0.
    pub uncovered: bool,
    /// τ: leave out a layer where the views cover only pixels with T below this, 0 for never. No channel of the picture
    /// changes by more than τ, no disparity by more than τ times the nearest layer's. A layer left out is never a pixel's best
    /// layer, and within τ the picture depends on the size of the batches: T is known only between them. Competing layers
    /// ([`crate::network::Alpha`]) do not hide one another: none of them is left out, whatever τ.
    pub transmittance: f64,
}

impl Culling {
    /// Every layer is rendered.
    pub const NONE: Self = Self { uncovered: false, transmittance: 0.0 };

    /// Whether a layer may be left out behind the layers in `gathered` (rows of the target): the largest T of a pixel that it
    /// covers, 0 if it covers none. `coverage` is `[V, height, width]` of the padded target.
    pub(super) fn hide(
        &self,
        coverage: &[f32],
        Size { width, height }: Size,
        gathered: &[impl CompositeRow],
    ) -> Option<f64> {
        if *self == Self::NONE {
            return None;
        }
        let mut largest = 0.0;
        for view in coverage.chunks_exact(height * width) {
            for (row, gathered) in view.chunks_exact(width).zip(gathered) {
                for (_, &left) in row.iter().zip(gathered.transmittance()).filter(|(covered, _)| **covered > 0.0) {
                    let hidden = left < self.transmittance;
                    if !hidden {
                        return None;
                    }
                    largest = left.max(largest);
                }
            }
        }
        (self.uncovered || largest > 0.0).then_some(largest)
    }

    /// Whether all layers behind those in `gathered` may be left out, whatever they cover: the largest T.
    pub(super) fn hide_rest(&self, gathered: &[impl CompositeRow]) -> Option<f64> {
        if self.transmittance <= 0.0 {
            return None;
        }
        let largest = gathered.iter().flat_map(CompositeRow::transmittance).copied().fold(0.0, f64::max);
        (largest < self.transmittance).then_some(largest)
    }
}

impl Default for Culling {
    /// Leaves out only what does not change the picture at all.
    fn default() -> Self {
        Self { uncovered: true, ..Self::NONE }
    }
}

/// Layers that were left out of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Culled {
    /// How many no view covers.
    pub uncovered: usize,
    /// How many are hidden behind nearer layers.
    pub opaque: usize,
    /// The largest T at which a hidden layer was left out, 0 if none was: no channel of the picture is further than this from the
    /// full render.
    pub transmittance: f64,
}

impl Culled {
    pub(crate) fn add_hidden(&mut self, layers: usize, transmittance: f64) {
        self.opaque += layers;
        self.transmittance = self.transmittance.max(transmittance);
    }
}
