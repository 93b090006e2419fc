//! One row of the target under either composite, and how the renderer fills it.

use rayon::prelude::*;

use super::blend::{Blended, LayerSamples, blend_run};
use super::buffers::Batch;
use super::composite::Accumulated;
use super::composite_competing::Competing;
use crate::warp::RunCoverage;

/// Rows of a layer that are blended before the same rows of the next layer. With no more than 8 the
/// processor prefetches the colours and logits of four views: 1 row takes a seventh longer (5.8
/// against 5.0 ms for two layers), 16 take as long.
const ROWS_TOGETHER: usize = 8;

/// Sums over layers for one row of the target.
pub(super) trait CompositeRow: Send + Sync {
    /// Adds a row of a layer behind those added before: `index` is the layer's among all, near →
    /// far, and `last` says whether it is the farthest. `logits` are logits 0; these and the
    /// disparities (1/scene unit) have at least one value per pixel.
    fn add_layer(&mut self, index: u32, last: bool, logits: &[f32], blended: &Blended, disparity: &[f32]);

    /// The composite.
    fn finish(self) -> Accumulated;
}

impl CompositeRow for Accumulated {
    fn add_layer(&mut self, index: u32, last: bool, _logits: &[f32], blended: &Blended, disparity: &[f32]) {
        self.add(index, blended, disparity, last);
    }

    fn finish(self) -> Accumulated {
        self
    }
}

impl CompositeRow for Competing {
    fn add_layer(&mut self, index: u32, _last: bool, logits: &[f32], blended: &Blended, disparity: &[f32]) {
        self.add(index, logits, blended, disparity);
    }

    fn finish(self) -> Accumulated {
        Competing::finish(self)
    }
}

/// Blends the layers of a batch, which have the given indices among `total`, and adds them to the
/// rows of a target `width` pixels wide.
pub(super) fn composite_batch(
    batch: &Batch<'_>,
    run_coverage: &[RunCoverage],
    indices: &[usize],
    total: usize,
    width: usize,
    rows: &mut [impl CompositeRow],
) {
    let (n, views, padded_height, padded_width) = batch.logits.dim();
    let [hwv, coverage, logits] = [batch.hwv, batch.coverage, batch.logits]
        .map(|values| values.to_slice().expect("views of the renderer's own buffers"));
    let (samples_per_layer, runs_per_layer) = (logits.len() / n, run_coverage.len() / n);
    let runs_per_view = runs_per_layer / views;
    let runs_per_row = runs_per_view / padded_height;
    rows.par_chunks_mut(ROWS_TOGETHER).enumerate().for_each_init(
        || Blended::new(width),
        |blended, (chunk, rows)| {
            let first = chunk * ROWS_TOGETHER;
            for ((k, disparity), &index) in batch.disparity.outer_iter().enumerate().zip(indices) {
                let samples = LayerSamples {
                    logits: &logits[k * samples_per_layer..(k + 1) * samples_per_layer],
                    colour: &hwv[3 * k * samples_per_layer..3 * (k + 1) * samples_per_layer],
                    coverage: &coverage[k * samples_per_layer..(k + 1) * samples_per_layer],
                    logit_shift: batch.logit_shifts[k],
                };
                for (y, row) in (first..).zip(&mut *rows) {
                    let of_views =
                        run_coverage[k * runs_per_layer..(k + 1) * runs_per_layer].chunks_exact(runs_per_view);
                    let of_views: Vec<_> =
                        of_views.map(|view| &view[y * runs_per_row..(y + 1) * runs_per_row]).collect();
                    blend_run(batch.weights, &samples, y * padded_width, &of_views, blended);
                    let disparity = disparity.row(y).to_slice().expect("rows of the renderer's own buffer");
                    let logits = &samples.logits[y * padded_width..];
                    row.add_layer(index as u32, index + 1 == total, logits, blended, disparity);
                }
            }
        },
    );
}
