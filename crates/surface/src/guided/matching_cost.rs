//! Matching cost of layers on a grid of cells: the variance of the warped colours of the views,
//! averaged over a window. The guided search ([`super::GuidedSearch`]) minimises it; it needs no
//! network.

use ndarray::{Array3, ArrayView3, Axis};
use rayon::prelude::*;

use liveview::geometry::{PlaneSweep, Size};
use liveview::warp::{Texture, WarpSource, warp_layers};

/// Cost where no cell of the window is covered by two views: above any variance of colours.
const UNCOVERED: f32 = 1.0;

/// Variance of the colours of the views, in [0, 1], on layers `maps` `[D, h, w]` (disparity per
/// cell, 1/scene unit), averaged over `window`×`window` cells: `[D, h, w]`. Cells are `cell` target
/// pixels wide; the views are shrunk by the same factor.
pub fn layer_costs(sources: &[WarpSource<'_>], maps: ArrayView3<'_, f32>, cell: usize, window: usize) -> Array3<f32> {
    let photos: Vec<_> = sources.iter().map(|s| (s.texture, s.gains)).collect();
    let sweeps: Vec<PlaneSweep> = sources.iter().map(|s| s.sweep).collect();
    Shrunk::new(&photos, cell).costs(&sweeps, maps, window)
}

/// Views shrunk to cells, to compute the costs of a target or of a part of one.
pub(crate) struct Shrunk {
    photos: Vec<(Texture, [f32; 3])>,
    cell: usize,
}

impl Shrunk {
    /// Shrinks photos, given with their gains per channel.
    pub(crate) fn new(photos: &[(&Texture, [f32; 3])], cell: usize) -> Self {
        Self { photos: photos.par_iter().map(|(texture, gains)| (texture.shrunk(cell), *gains)).collect(), cell }
    }

    /// As [`layer_costs`]; one sweep per view.
    pub(crate) fn costs(&self, sweeps: &[PlaneSweep], maps: ArrayView3<'_, f32>, window: usize) -> Array3<f32> {
        let pairs = self.photos.iter().zip(sweeps);
        let sources: Vec<_> = pairs
            .map(|((texture, gains), sweep)| {
                let sweep = sweep.shrunk(self.cell as f64);
                WarpSource { texture, sweep, gains: *gains }
            })
            .collect();
        let (_, height, width) = maps.dim();
        let plane = height * width;
        let mut costs = Array3::zeros(maps.dim());
        let layers = costs.as_slice_mut().expect("standard order").par_chunks_mut(plane).enumerate();
        layers.for_each(|(layer, cost)| {
            let disparity: Vec<f32> = maps.index_axis(Axis(0), layer).iter().copied().collect();
            let mut colour = vec![0.0; 3 * sources.len() * plane];
            let mut coverage = vec![0.0; sources.len() * plane];
            warp_layers(&disparity, &sources, Size::new(width, height), &mut colour, &mut coverage);
            window_variance(&mut colour, &coverage, width, (window, UNCOVERED), cost);
        });
        costs
    }
}

/// Variance of the colours of the views that cover more than half of a cell, averaged over the cells
/// of a window that two views cover; `uncovered` where there are none. Rows of cells `width` wide;
/// `colour` `[V, 3, h, w]` is divided by the coverage `[V, h, w]`.
pub(crate) fn window_variance(
    colour: &mut [f32],
    coverage: &[f32],
    width: usize,
    window: (usize, f32),
    out: &mut [f32],
) {
    let (mut variance, mut covered) = (vec![0.0; out.len()], vec![0.0; out.len()]);
    variances(colour, coverage, width, &mut variance, &mut covered);
    window_means(&variance, &covered, width, window, out);
}

/// Variance of the colours of the views that cover more than half of a cell (0 where fewer than two
/// do), and whether two do (1 or 0). `colour` is divided by the coverage. Row by row, which stays in the
/// cache; simple loops, which the compiler vectorises.
#[pulp::with_simd(variances = liveview::simd::arch())]
#[inline(always)]
fn variances_with<'a, S: pulp::Simd>(
    _simd: S,
    colour: &'a mut [f32],
    coverage: &'a [f32],
    width: usize,
    variance: &'a mut [f32],
    covered: &'a mut [f32],
) {
    let (plane, covers) = (variance.len(), |coverage: f32| if coverage > 0.5 { 1.0 } else { 0.0 });
    let (mut mean, mut squares) = (vec![0.0; width], vec![0.0; width]);
    for (y, (total, count)) in variance.chunks_exact_mut(width).zip(covered.chunks_exact_mut(width)).enumerate() {
        let row = y * width..(y + 1) * width;
        for coverage in coverage.chunks_exact(plane) {
            count.iter_mut().zip(&coverage[row.clone()]).for_each(|(count, &c)| *count += covers(c));
        }
        for channel in 0..3 {
            mean.fill(0.0);
            for (colour, coverage) in colour.chunks_exact_mut(3 * plane).zip(coverage.chunks_exact(plane)) {
                let colour = &mut colour[channel * plane..][row.clone()];
                for ((value, mean), &c) in colour.iter_mut().zip(&mut mean).zip(&coverage[row.clone()]) {
                    *value = *value / if c > 0.5 { c } else { 1.0 } * covers(c);
                    *mean += *value;
                }
            }
            mean.iter_mut().zip(&*count).for_each(|(mean, &count): (&mut f32, &f32)| *mean /= count.max(1.0));
            squares.fill(0.0);
            for (colour, coverage) in colour.chunks_exact(3 * plane).zip(coverage.chunks_exact(plane)) {
                let colour = &colour[channel * plane..][row.clone()];
                for (((square, &value), &mean), &c) in
                    squares.iter_mut().zip(colour).zip(&mean).zip(&coverage[row.clone()])
                {
                    *square += (value - mean) * (value - mean) * covers(c);
                }
            }
            total.iter_mut().zip(&squares).for_each(|(total, square): (&mut f32, &f32)| *total += square);
        }
        for (total, count) in total.iter_mut().zip(count) {
            let two = if *count >= 2.0 { 1.0 } else { 0.0 };
            *total = *total / (3.0 * (*count - 1.0).max(1.0)) * two;
            *count = two;
        }
    }
}

/// Mean of `value` over the cells of the window where `covered` is 1; `uncovered` where there are none.
#[pulp::with_simd(window_means = liveview::simd::arch())]
#[inline(always)]
fn window_means_with<'a, S: pulp::Simd>(
    _simd: S,
    value: &'a [f32],
    covered: &'a [f32],
    width: usize,
    (window, uncovered): (usize, f32),
    out: &'a mut [f32],
) {
    let (half, height) = (window / 2, out.len() / width);
    let (mut sums, mut counts) = (vec![0.0; width + 2 * half], vec![0.0; width + 2 * half]); // zeros beyond the edges
    let mut count = vec![0.0; width];
    for (y, out) in out.chunks_exact_mut(width).enumerate() {
        let rows = y.saturating_sub(half) * width..(y + half + 1).min(height) * width;
        for (sums, values, total) in [(&mut sums, value, &mut *out), (&mut counts, covered, &mut count)] {
            let down = &mut sums[half..half + width];
            down.fill(0.0);
            for row in values[rows.clone()].chunks_exact(width) {
                down.iter_mut().zip(row).for_each(|(sum, v)| *sum += v);
            }
            total.fill(0.0);
            for across in sums.windows(width) {
                total.iter_mut().zip(across).for_each(|(total, sum)| *total += sum);
            }
        }
        for (out, &count) in out.iter_mut().zip(&count) {
            *out = if count > 0.0 { *out / count } else { uncovered };
        }
    }
}
