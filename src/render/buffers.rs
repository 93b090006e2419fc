//! Buffers of the layers that are processed together, from warp to composite.

use std::collections::TryReserveError;

use ndarray::{ArrayView3, ArrayView4, ArrayViewMut4, Axis};
use rayon::prelude::*;

use super::RenderError;
use super::blend::DistanceWeights;
use super::visibility::hide_occluded;
use crate::geometry::Size;
use crate::layers::Layer;
use crate::network::{NetworkError, PlaneNetwork};
use crate::warp::{OwnDisparity, RunCoverage, WarpSource, WarpedLayers, run_coverage_len, warp_layers_into};

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
    /// Factors of the view weights.
    pub weights: &'a DistanceWeights,
}

/// Resizes a buffer; new values are 0, or unknown coverage.
fn resize<T: Clone + Default>(buffer: &mut Vec<T>, len: usize) -> Result<(), TryReserveError> {
    buffer.try_reserve_exact(len.saturating_sub(buffer.len()))?;
    buffer.resize(len, T::default());
    Ok(())
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

    /// Makes room for `layers` layers of `views` views on a padded target of that size.
    pub(crate) fn make_room(&mut self, layers: usize, views: usize, size: Size) -> Result<(), RenderError> {
        let (pixels, runs) = (layers * size.pixels(), layers * views * run_coverage_len(size));
        if (self.views, self.size, self.run_coverage.len()) == (views, size, runs) {
            return Ok(()); // the run coverage stays valid
        }
        let failed = |_| RenderError::Memory { bytes: Self::bytes(layers, views, size) };
        resize(&mut self.disparity, pixels).map_err(failed)?;
        resize(&mut self.hwv, 3 * views * pixels).map_err(failed)?;
        resize(&mut self.coverage, views * pixels).map_err(failed)?;
        resize(&mut self.logits, views * pixels).map_err(failed)?;
        self.run_coverage.clear();
        resize(&mut self.run_coverage, runs).map_err(failed)?;
        resize(&mut self.seen, runs).map_err(failed)?;
        (self.views, self.size) = (views, size);
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
        own_depth: &[OwnDisparity<'_>],
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
        let coverage = ArrayView4::from_shape((n, views, height, width), &self.coverage[..n * samples]);
        let (hwv, mut logits) = (hwv.expect("of one size"), logits.expect("of one size"));
        let coverage = coverage.expect("of one size");
        let batches = hwv.axis_chunks_iter(Axis(0), batch).zip(coverage.axis_chunks_iter(Axis(0), batch));
        let mut batches = batches.zip(logits.axis_chunks_iter_mut(Axis(0), batch));
        batches.try_for_each(|((hwv, coverage), logits)| network.infer(hwv, coverage, logits))?;
        let logits = &self.logits[..n * samples];
        let not_finite = logits.par_chunks(LOGITS_PER_TASK).map(|part| part.iter().filter(|x| !x.is_finite()).count());
        Ok((logits.len(), not_finite.sum()))
    }

    /// The first `n` layers, and their run coverage `[n, V, run_coverage_len]`.
    pub(crate) fn batch<'a>(&'a self, n: usize, weights: &'a DistanceWeights) -> (Batch<'a>, &'a [RunCoverage]) {
        let [pixels, _, runs] = self.lengths();
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
            weights,
        };
        (batch, &self.run_coverage[..n * runs])
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec2, DVec3};

    use super::*;
    use crate::geometry::PlaneSweep;
    use crate::image::ImageRgb;
    use crate::layers::Layers;
    use crate::render::blend::{Blended, LayerSamples, blend_run};
    use crate::warp::Texture;

    const SIZE: Size = Size::new(400, 40);
    const PIXELS: usize = SIZE.pixels();

    /// Three planes and three views. The first two views cover nothing of the nearest plane, the
    /// left and the right half of the next, and all but an edge of the farthest; the third view
    /// covers all but an edge of each.
    fn warped() -> Buffers {
        let values = (0..3 * PIXELS).map(|i| (i % 251) as f32 / 250.0).collect();
        let texture = Texture::new(&ImageRgb::new(SIZE.width, SIZE.height, values).unwrap());
        let source = |x, y| {
            let sweep = PlaneSweep {
                homography_at_infinity: DMat3::from_translation(DVec2::new(-3.3, 0.2)),
                epipole: DVec3::new(x, y, 0.0),
            };
            WarpSource::new(&texture, sweep)
        };
        let mut buffers = Buffers::default();
        buffers.make_room(3, 3, SIZE).unwrap();
        let planes = Layers::planes(&[2.0, 1.0, 1e-3]).unwrap();
        let sources = [source(-210.0, 5.0), source(210.0, -5.0), source(1.0, 0.5)];
        buffers.warp(planes.as_slice().iter().enumerate(), &sources, &[], &mut Vec::new());
        buffers
    }

    #[test]
    fn run_coverage_does_not_change_the_blend_by_a_bit() {
        let mut buffers = warped();
        let logit = |i: usize| if i.is_multiple_of(97) { f32::INFINITY } else { (i * 31 % 113) as f32 / 9.0 - 6.0 };
        buffers.logits.iter_mut().enumerate().for_each(|(i, value)| *value = logit(i));
        let per_row = run_coverage_len(Size::new(SIZE.width, 1));
        let mut met = [0; 3];
        for distances in [[1.0, 2.0, 3.0], [0.0, 1.0, 0.0]] {
            let weights = DistanceWeights::new(&distances);
            for layer in 0..3 {
                let samples = LayerSamples {
                    logits: &buffers.logits[3 * layer * PIXELS..][..3 * PIXELS],
                    colour: &buffers.hwv[9 * layer * PIXELS..][..9 * PIXELS],
                    coverage: buffers.coverage(layer),
                };
                for row in 0..SIZE.height {
                    let of_view = |view: usize| {
                        &buffers.run_coverage[((3 * layer + view) * SIZE.height + row) * per_row..][..per_row]
                    };
                    let run_coverage = [0, 1, 2].map(of_view);
                    let [mut with_runs, mut without] = [(); 2].map(|()| Blended::new(SIZE.width));
                    blend_run(&samples, &weights, row * SIZE.width, &run_coverage, &mut with_runs);
                    samples.blend(&weights, row * SIZE.width, &mut without);
                    assert_eq!(with_runs, without, "{distances:?}, layer {layer}, row {row}");
                    // The blend takes two runs at once: it reads their coverage unless both have
                    // the same summary.
                    let pairs =
                        run_coverage.iter().flat_map(|row| row.chunks_exact(2)).filter(|pair| pair[0] == pair[1]);
                    pairs.for_each(|pair| met[pair[0] as usize] += 1);
                }
            }
        }
        assert!(met.iter().all(|&pairs| pairs > 20), "{met:?}");
    }

    #[test]
    fn moved_layer_keeps_its_run_coverage() {
        let mut buffers = warped();
        let weights = DistanceWeights::new(&[1.0; 3]);
        let layer = |buffers: &Buffers, slot: usize| {
            let (batch, run_coverage) = buffers.batch(3, &weights);
            let runs = run_coverage.len() / 3;
            let planes = [batch.hwv, batch.coverage].map(|planes| planes.index_axis_move(Axis(0), slot).to_owned());
            (planes, batch.disparity.index_axis(Axis(0), slot).to_owned(), run_coverage[slot * runs..][..runs].to_vec())
        };
        let (near, far) = (layer(&buffers, 0), layer(&buffers, 2));
        assert!(near.2 != far.2);
        buffers.move_layer(2, 0);
        assert!(layer(&buffers, 0) == far);
    }
}
