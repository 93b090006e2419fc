//! Matching cost of layers on a grid of cells: the variance of the warped colours of the views,
//! averaged over a window. The guided search ([`super::GuidedSearch`]) minimises it; it needs no
//! network.

use ndarray::{Array3, ArrayView3, Axis};
use rayon::prelude::*;

use crate::geometry::{PlaneSweep, Size};
use crate::warp::{Texture, WarpSource, warp_layers};

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
        let sources: Vec<_> = self
            .photos
            .iter()
            .zip(sweeps)
            .map(|((texture, gains), sweep)| WarpSource {
                texture,
                sweep: sweep.shrunk(self.cell as f64),
                gains: *gains,
            })
            .collect();
        window_costs(&sources, maps, window)
    }
}

/// As [`layer_costs`], of views that are already shrunk.
fn window_costs(sources: &[WarpSource<'_>], maps: ArrayView3<'_, f32>, window: usize) -> Array3<f32> {
    let (_, height, width) = maps.dim();
    let plane = height * width;
    let mut costs = Array3::zeros(maps.dim());
    let layers = costs.as_slice_mut().expect("standard order").par_chunks_mut(plane).enumerate();
    layers.for_each(|(layer, cost)| {
        let disparity: Vec<f32> = maps.index_axis(Axis(0), layer).iter().copied().collect();
        let mut colour = vec![0.0; 3 * sources.len() * plane];
        let mut coverage = vec![0.0; sources.len() * plane];
        warp_layers(&disparity, sources, Size::new(width, height), &mut colour, &mut coverage);
        window_variance(&mut colour, &coverage, width, (window, UNCOVERED), cost);
    });
    costs
}

/// Variance of the colours of the views that cover more than half of a cell, averaged over the cells
/// of a window that two views cover; `uncovered` where there are none. Rows of cells `width` wide;
/// `colour` `[V, 3, h, w]` is divided by the coverage `[V, h, w]`.
pub(crate) fn window_variance(
    colour: &mut [f32],
    coverage: &[f32],
    width: usize,
    (window, uncovered): (usize, f32),
    out: &mut [f32],
) {
    let (variance, covered) = variance(colour, coverage, out.len());
    window_mean(&variance, &covered, width, (window, uncovered), out);
}

/// Variance of the colours of the views that cover more than half of a cell (0 where fewer than two
/// do), and whether two do (1 or 0). `colour` is divided by the coverage. Simple loops over planes,
/// which the compiler vectorises.
fn variance(colour: &mut [f32], coverage: &[f32], plane: usize) -> (Vec<f32>, Vec<f32>) {
    let covered = |coverage: f32| if coverage > 0.5 { 1.0 } else { 0.0 };
    let mut count = vec![0.0; plane];
    for coverage in coverage.chunks_exact(plane) {
        count.iter_mut().zip(coverage).for_each(|(count, &c)| *count += covered(c));
    }
    let mut total = vec![0.0; plane];
    for channel in 0..3 {
        let mut mean = vec![0.0; plane];
        for (colour, coverage) in
            colour.chunks_exact_mut(plane).skip(channel).step_by(3).zip(coverage.chunks_exact(plane))
        {
            for ((value, mean), &c) in colour.iter_mut().zip(&mut mean).zip(coverage) {
                *value = *value / if c > 0.5 { c } else { 1.0 } * covered(c);
                *mean += *value;
            }
        }
        mean.iter_mut().zip(&count).for_each(|(mean, &count): (&mut f32, &f32)| *mean /= count.max(1.0));
        let mut squares = vec![0.0; plane];
        for (colour, coverage) in colour.chunks_exact(plane).skip(channel).step_by(3).zip(coverage.chunks_exact(plane))
        {
            for (((square, &value), &mean), &c) in squares.iter_mut().zip(colour).zip(&mean).zip(coverage) {
                *square += (value - mean) * (value - mean) * covered(c);
            }
        }
        total.iter_mut().zip(&squares).for_each(|(total, square): (&mut f32, &f32)| *total += square);
    }
    for (total, count) in total.iter_mut().zip(&mut count) {
        let two = if *count >= 2.0 { 1.0 } else { 0.0 };
        *total = *total / (3.0 * (*count - 1.0).max(1.0)) * two;
        *count = two;
    }
    (total, count)
}

/// Mean of `value` over the cells of the window where `covered` is 1; `uncovered` where there are none.
fn window_mean(value: &[f32], covered: &[f32], width: usize, (window, uncovered): (usize, f32), out: &mut [f32]) {
    let (half, height) = (window / 2, out.len() / width);
    let (mut sums, mut counts) = (vec![0.0; width + 2 * half], vec![0.0; width + 2 * half]); // zeros beyond the edges
    for (y, out) in out.chunks_exact_mut(width).enumerate() {
        let rows = y.saturating_sub(half) * width..(y + half + 1).min(height) * width;
        for (sums, values) in [(&mut sums, value), (&mut counts, covered)] {
            let sums = &mut sums[half..half + width];
            sums.fill(0.0);
            for row in values[rows.clone()].chunks_exact(width) {
                sums.iter_mut().zip(row).for_each(|(sum, v)| *sum += v);
            }
        }
        let across = |sums: &[f32], x: usize| sums[x..x + 2 * half + 1].iter().sum::<f32>();
        for (x, out) in out.iter_mut().enumerate() {
            let count = across(&counts, x);
            *out = if count > 0.0 { across(&sums, x) / count } else { uncovered };
        }
    }
}
