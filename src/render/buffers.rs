//! Buffers of the layers that are processed together, from warp to composite.

use ndarray::{ArrayView3, ArrayView4, ArrayViewMut4, Axis};
use rayon::prelude::*;

use super::blend::DistanceWeights;
use super::visibility::hide_occluded;
use crate::fs::memory::{self, MemoryError};
use crate::geometry::Size;
use crate::layers::Layer;
use crate::network::{NetworkError, PlaneNetwork};
use crate::warp::{OwnDepth, RunCoverage, WarpSource, WarpedLayers, run_coverage_len, warp_layers_into};

/// The stages of n layers over the padded target of h × w pixels, as an observer is shown them
/// ([`super::RenderRequest::observer`]).
#[derive(Debug, Clone, Copy)]
pub struct Batch<'a> {
    /// Disparity of n layers, near → far, `[n, h, w]`, 1/scene unit.
    pub disparity: ArrayView3<'a, f32>,
    /// Homography warped volume `[n, 3V, h, w]`, RGB in [0, 1].
    pub hwv: ArrayView4<'a, f32>,
    /// Coverage `[n, V, h, w]`, in [0, 1].
    pub coverage: ArrayView4<'a, f32>,
    /// The network's output `[n, V, h, w]`.
    pub logits: ArrayView4<'a, f32>,
    /// Added to logit 0 of each layer, `[n]` ([`super::LayerSamples::logit_shift`]).
    pub logit_shifts: &'a [f64],
    /// Factors of the view weights.
    pub weights: &'a DistanceWeights,
}

/// Logits that one task counts.
const LOGITS_PER_TASK: usize = 1 << 16;

/// Buffers for a number of layers, kept from frame to frame; a slot holds one layer.
#[derive(Default)]
pub(crate) struct Buffers {
    views: usize,
    /// Size of the padded target.
    size: Size,
    disparity: Vec<f32>,
    hwv: Vec<f32>,
    coverage: Vec<f32>,
    run_coverage: Vec<RunCoverage>,
    /// For each run a bit per pixel, set where the view is not occluded; valid from the warp to
    /// [`Self::hide_occluded`].
    seen: Vec<u64>,
    logits: Vec<f32>,
}

impl Buffers {
    /// Bytes for `layers` layers of `views` views on a padded target of that size.
    pub(crate) fn bytes(layers: usize, views: usize, size: Size) -> usize {
        // Disparity, and of each view colour, coverage and a logit.
        let run = size_of::<RunCoverage>() + size_of::<u64>();
        layers * (size.pixels() * size_of::<f32>() * (1 + 5 * views) + views * run_coverage_len(size) * run)
    }

    /// Bytes that are allocated.
    fn held(&self) -> usize {
        let values = [&self.disparity, &self.hwv, &self.coverage, &self.logits].map(Vec::capacity);
        let runs = self.run_coverage.capacity() * size_of::<RunCoverage>() + self.seen.capacity() * size_of::<u64>();
        values.iter().sum::<usize>() * size_of::<f32>() + runs
    }

    /// Makes room for `layers` layers of `views` views on a padded target of that size.
    pub(crate) fn make_room(&mut self, layers: usize, views: usize, size: Size) -> Result<(), MemoryError> {
        let more = Self::bytes(layers, views, size).saturating_sub(self.held());
        if more > 0 {
            memory::check(more as u64)?;
        }
        let (pixels, runs) = (layers * size.pixels(), layers * views * run_coverage_len(size));
        if (self.views, self.size, self.run_coverage.len()) == (views, size, runs) {
            return Ok(()); // the run coverage stays valid
        }
        (self.views, self.size) = (views, size);
        self.disparity.resize(pixels, 0.0);
        self.hwv.resize(3 * views * pixels, 0.0);
        self.coverage.resize(views * pixels, 0.0);
        self.logits.resize(views * pixels, 0.0);
        self.run_coverage.clear();
        self.run_coverage.resize(runs, RunCoverage::Partial);
        self.seen.resize(runs, 0);
        Ok(())
    }

    /// Lengths of the disparity, the coverage and the run coverage of one layer.
    fn lengths(&self) -> [usize; 3] {
        let pixels = self.size.pixels();
        [pixels, self.views * pixels, self.views * run_coverage_len(self.size)]
    }

    /// Warps the next layers of `remaining`, one per slot, and writes their indices to `indices`.
    /// `own_depth` is that of the views, or empty.
    pub(crate) fn warp<'a>(
        &mut self,
        remaining: impl Iterator<Item = (usize, &'a Layer)>,
        sources: &[WarpSource<'_>],
        own_depth: &[OwnDepth<'_>],
        indices: &mut Vec<usize>,
    ) {
        let [pixels, ..] = self.lengths();
        indices.clear();
        for (disparity, (index, layer)) in self.disparity.chunks_exact_mut(pixels).zip(remaining) {
            layer.fill(self.size.width, disparity);
            indices.push(index);
        }
        warp_layers_into(sources, own_depth, self.size, &mut self.layers(indices.len()));
    }

    /// The first `n` layers.
    fn layers(&mut self, n: usize) -> WarpedLayers<'_> {
        let [pixels, samples, runs] = self.lengths();
        WarpedLayers {
            disparity: &self.disparity[..n * pixels],
            colour: &mut self.hwv[..n * 3 * samples],
            coverage: &mut self.coverage[..n * samples],
            run_coverage: &mut self.run_coverage[..n * runs],
            seen: &mut self.seen[..n * runs],
        }
    }

    /// Sets colour and coverage of the first `n` layers, which were warped with the views' own
    /// depth, to 0 where a view is occluded; `visible` becomes true where some view is not.
    pub(crate) fn hide_occluded(&mut self, n: usize, visible: &mut [bool]) {
        let (views, size) = (self.views, self.size);
        hide_occluded(views, size, &mut self.layers(n), visible);
    }

    /// Drops the layers that no view covers at any pixel of the target, and moves the others
    /// together; `indices` are those of the layers in the first slots. Returns how many it dropped.
    pub(crate) fn drop_uncovered(&mut self, indices: &mut Vec<usize>, target: Size) -> usize {
        let (warped, mut kept) = (indices.len(), 0);
        for slot in 0..warped {
            if self.is_covered(slot, target) {
                self.move_layer(slot, kept);
                indices[kept] = indices[slot];
                kept += 1;
            }
        }
        indices.truncate(kept);
        warped - kept
    }

    /// Whether any view covers any pixel of the target on the layer in `slot`.
    fn is_covered(&self, slot: usize, target: Size) -> bool {
        let mut rows = self
            .coverage(slot)
            .chunks_exact(self.size.pixels())
            .flat_map(|view| view.chunks_exact(self.size.width).take(target.height).map(|row| &row[..target.width]));
        rows.any(|row| row.iter().any(|&coverage| coverage > 0.0))
    }

    /// Coverage of the layer in `slot`, `[V, h, w]`.
    fn coverage(&self, slot: usize) -> &[f32] {
        let [_, samples, _] = self.lengths();
        &self.coverage[slot * samples..][..samples]
    }

    /// Copies a layer to a slot whose layer is no longer needed.
    fn move_layer(&mut self, from: usize, to: usize) {
        fn move_slot<T: Copy>(buffer: &mut [T], length: usize, from: usize, to: usize) {
            buffer.copy_within(from * length..(from + 1) * length, to * length);
        }
        let [pixels, samples, runs] = self.lengths();
        if from != to {
            move_slot(&mut self.disparity, pixels, from, to);
            move_slot(&mut self.hwv, 3 * samples, from, to);
            move_slot(&mut self.coverage, samples, from, to);
            move_slot(&mut self.run_coverage, runs, from, to);
        }
    }

    /// Runs the network on the first `n` layers, `batch` at once; returns the number of their logits,
    /// and of those that are NaN or infinite.
    pub(crate) fn infer(
        &mut self,
        network: &mut dyn PlaneNetwork,
        n: usize,
        batch: usize,
    ) -> Result<(usize, usize), NetworkError> {
        let [_, samples, _] = self.lengths();
        let (views, Size { width, height }) = (self.views, self.size);
        let hwv = ArrayView4::from_shape((n, 3 * views, height, width), &self.hwv[..n * 3 * samples]);
        let logits = ArrayViewMut4::from_shape((n, views, height, width), &mut self.logits[..n * samples]);
        let (hwv, mut logits) = (hwv.expect("of one size"), logits.expect("of one size"));
        let batches = hwv.axis_chunks_iter(Axis(0), batch).zip(logits.axis_chunks_iter_mut(Axis(0), batch));
        batches.into_iter().try_for_each(|(hwv, logits)| network.infer(hwv, logits))?;
        let logits = &self.logits[..n * samples];
        let not_finite = logits.par_chunks(LOGITS_PER_TASK).map(|part| part.iter().filter(|x| !x.is_finite()).count());
        Ok((logits.len(), not_finite.sum()))
    }

    /// The first n layers, where n is the number of shifts, and their run coverage `[n, V,
    /// run_coverage_len]`.
    pub(crate) fn batch<'a>(
        &'a self,
        logit_shifts: &'a [f64],
        weights: &'a DistanceWeights,
    ) -> (Batch<'a>, &'a [RunCoverage]) {
        let [pixels, _, runs] = self.lengths();
        let n = logit_shifts.len();
        let (views, Size { width, height }) = (self.views, self.size);
        let planes = |channels: usize, values: &'a [f32]| {
            let shape = (n, channels, height, width);
            ArrayView4::from_shape(shape, &values[..n * channels * pixels]).expect("of one size")
        };
        let disparity = ArrayView3::from_shape((n, height, width), &self.disparity[..n * pixels]);
        let batch = Batch {
            disparity: disparity.expect("of one size"),
            hwv: planes(3 * views, &self.hwv),
            coverage: planes(views, &self.coverage),
            logits: planes(views, &self.logits),
            logit_shifts,
            weights,
        };
        (batch, &self.run_coverage[..n * runs])
    }
}

#[cfg(test)]
mod tests;
