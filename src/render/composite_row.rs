//! One row of the target under either composite, as the renderer fills it.

use super::blend::Blended;
use super::composite::Accumulated;
use super::composite_competing::Competing;

/// One row of a layer.
pub(super) struct LayerRow<'a> {
    /// Its place among all layers, near → far.
    pub(super) index: usize,
    /// Whether it is the farthest.
    pub(super) last: bool,
    /// Logits 0, as many as the row holds or more.
    pub(super) logits: &'a [f32],
    pub(super) blended: &'a Blended,
    /// 1/scene unit, as many as the row holds or more.
    pub(super) disparity: &'a [f32],
}

/// Sums over layers for one row of the target.
pub(super) trait CompositeRow: Send + Sync {
    /// Adds a layer behind those that were added before.
    fn add_layer(&mut self, layer: &LayerRow<'_>);

    /// For each pixel the largest weight that layers still to come can have, all together.
    fn transmittance(&self) -> &[f64];

    /// The composite.
    fn finish(self) -> Accumulated;
}

impl CompositeRow for Accumulated {
    fn add_layer(&mut self, layer: &LayerRow<'_>) {
        self.add(layer.index as u32, layer.blended, layer.disparity, layer.last);
    }

    fn transmittance(&self) -> &[f64] {
        &self.transmittance
    }

    fn finish(self) -> Accumulated {
        self
    }
}

impl CompositeRow for Competing {
    fn add_layer(&mut self, layer: &LayerRow<'_>) {
        self.add(layer.index as u32, layer.logits, layer.blended, layer.disparity);
    }

    /// 1: a layer to come may outweigh all before it, so that none hides another.
    fn transmittance(&self) -> &[f64] {
        Competing::transmittance(self)
    }

    fn finish(self) -> Accumulated {
        Competing::finish(self)
    }
}
