//! Matching cost of layers on a grid of cells: the variance of the warped colours of the views,
//! averaged over a window; no network is needed. Aggregated by semi-global matching (Hirschmüller, 2008)
//! along image rows and columns, four paths; the disparity of least cost wins at each cell.

use ndarray::{Array2, Array3, ArrayView3, Axis};
use rayon::prelude::*;

use liveview::geometry::{PlaneSweep, Size};
use liveview::warp::{SourceView, Texture, WarpSource, warp_layers};

/// Cost where no cell of the window is covered by two views: above any variance of colours.
const UNCOVERED: f32 = 1.0;

/// Views shrunk to cells, to compute the costs of a target or of a part of one.
pub(crate) struct Shrunk {
    photos: Vec<Texture>,
    cell: usize,
}

impl Shrunk {
    /// Shrinks photos.
    pub(crate) fn new(views: &[SourceView<'_>], cell: usize) -> Self {
        Self { photos: views.par_iter().map(|view| view.texture.shrunk(cell)).collect(), cell }
    }

    /// Variance of the colours of the views, in [0, 1], on layers `maps` `[D, h, w]` (disparity per
    /// cell, 1/scene unit), averaged over `window`×`window` cells: `[D, h, w]`. One sweep per view.
    pub(crate) fn costs(&self, sweeps: &[PlaneSweep], maps: ArrayView3<'_, f32>, window: usize) -> Array3<f32> {
        let source = |(texture, sweep): (_, &PlaneSweep)| WarpSource::new(texture, sweep.shrunk(self.cell as f64));
        let sources: Vec<_> = self.photos.iter().zip(sweeps).map(source).collect();
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

/// Penalties of a move along a path, in units of the cost: a variance of colours in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Penalties {
    /// Of a step to the next plane.
    pub(crate) step: f32,
    /// Of a jump to any other plane.
    pub(crate) jump: f32,
}

/// Sum over the four directions (down, up, right, left) of the cost of the cheapest path to each
/// cell, `[D, h, w]` → `[D, h, w]`.
pub(crate) fn semi_global(costs: ArrayView3<'_, f32>, penalties: Penalties) -> Array3<f32> {
    // The dimension that a path runs along comes first, that of parallel paths last, so that each
    // step is one pass over rows in memory.
    let down = costs.permuted_axes([1, 0, 2]).as_standard_layout().into_owned();
    let across = costs.permuted_axes([2, 0, 1]).as_standard_layout().into_owned();
    let both = |costs: &Array3<f32>| {
        let (mut there, back) = rayon::join(|| path(costs, penalties, false), || path(costs, penalties, true));
        there += &back;
        there
    };
    let (vertical, horizontal) = rayon::join(|| both(&down), || both(&across));
    vertical.permuted_axes([1, 0, 2]).as_standard_layout().into_owned() + horizontal.permuted_axes([1, 2, 0])
}

/// The paths of one direction through `costs` `[steps, D, lanes]`: the cost of the cell, plus the
/// least of staying on the plane, stepping to the next one and jumping to any other, less the least
/// cost of the step before (which keeps the sums small and changes no comparison).
fn path(costs: &Array3<f32>, penalties: Penalties, backwards: bool) -> Array3<f32> {
    let (steps, planes, lanes) = costs.dim();
    let size = planes * lanes;
    let mut total = costs.clone();
    let all = total.as_slice_mut().expect("standard order");
    let mut best = vec![0.0; lanes];
    for step in 1..steps {
        let at = if backwards { steps - step } else { step };
        let (first, second) = all[(at - 1) * size..(at + 1) * size].split_at_mut(size);
        let (before, here) = if backwards { (second, first) } else { (first, second) };
        advance(before, here, &mut best, penalties);
    }
    total
}

/// One step of parallel paths: `here` `[D, lanes]` are the costs of the cells and become those of the
/// paths; `best` is a row to work in.
#[pulp::with_simd(advance = liveview::simd::arch())]
#[inline(always)]
fn advance_with<'a, S: pulp::Simd>(
    _simd: S,
    before: &'a [f32],
    here: &'a mut [f32],
    best: &'a mut [f32],
    penalties: Penalties,
) {
    let lanes = best.len();
    let planes = before.len() / lanes;
    best.copy_from_slice(&before[..lanes]);
    for row in before.chunks_exact(lanes) {
        best.iter_mut().zip(row).for_each(|(best, &cost)| *best = if cost < *best { cost } else { *best });
    }
    for (plane, here) in here.chunks_exact_mut(lanes).enumerate() {
        let row = |plane: usize| &before[plane * lanes..(plane + 1) * lanes];
        let (nearer, same, farther) = (row(plane.saturating_sub(1)), row(plane), row((plane + 1).min(planes - 1)));
        let beside = here.iter_mut().zip(nearer).zip(farther).zip(same).zip(&*best);
        for ((((here, &nearer), &farther), &same), &best) in beside {
            // At the first and the last plane one of the two is the plane itself, whose cost
            // plus the penalty is never the least.
            let step = if nearer < farther { nearer } else { farther } + penalties.step;
            let stay = if same < step { same } else { step };
            let jump = best + penalties.jump;
            *here += (if stay < jump { stay } else { jump }) - best;
        }
    }
}

/// Disparity `[h, w]` of the layer of least cost at each cell (ties: the nearer). Except at the
/// first and the last layer it is refined to the vertex of the parabola through the cost of the
/// layer and the costs of its two neighbours. `costs` and the layers' disparities `maps` (1/scene
/// unit) are `[D, h, w]`.
///
/// # Panics
///
/// If there are no layers, or the shapes differ.
pub(crate) fn winner_takes_all(costs: ArrayView3<'_, f32>, maps: ArrayView3<'_, f32>) -> Array2<f32> {
    let (layers, height, width) = costs.dim();
    let mut best = Array2::<u32>::zeros((height, width));
    let mut least = costs.index_axis(Axis(0), 0).to_owned();
    for (layer, cost) in costs.outer_iter().enumerate().skip(1) {
        ndarray::Zip::from(&mut best).and(&mut least).and(cost).for_each(|best, least, &cost| {
            if cost < *least {
                (*best, *least) = (layer as u32, cost);
            }
        });
    }
    Array2::from_shape_fn((height, width), |(y, x)| {
        let k = best[(y, x)] as usize;
        if k == 0 || k + 1 == layers {
            return maps[(k, y, x)];
        }
        let [nearer, here, farther] = [k - 1, k, k + 1].map(|k| f64::from(costs[(k, y, x)]));
        let curvature = nearer - 2.0 * here + farther;
        let shift = if curvature > 0.0 { 0.5 * (nearer - farther) / curvature } else { 0.0 };
        let towards = if shift > 0.0 { k + 1 } else { k - 1 };
        let [own, towards] = [k, towards].map(|k| f64::from(maps[(k, y, x)]));
        (own + shift.abs() * (towards - own)) as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const PENALTIES: Penalties = Penalties { step: 0.004, jump: 0.1 };

    #[test]
    fn ambiguous_cell_takes_the_plane_of_its_neighbours() {
        let mut costs = Array3::from_elem((3, 1, 5), 0.05);
        (0..5).filter(|&x| x != 2).for_each(|x| costs[(1, 0, x)] = 0.0);
        let aggregated = semi_global(costs.view(), PENALTIES);
        let [nearer, here, farther] = [0, 1, 2].map(|plane| aggregated[(plane, 0, 2)]);
        assert!(here < nearer && here < farther, "{aggregated}");
    }

    #[test]
    fn single_plane_adds_up_its_costs() {
        let costs = Array3::from_shape_fn((1, 2, 2), |(_, y, x)| (y + x) as f32);
        assert_eq!(semi_global(costs.view(), PENALTIES), 4.0 * costs);
    }

    /// Views whose colours and coverage are pseudorandom.
    #[test]
    fn window_variance_equals_its_definition() {
        let (width, height, views) = (9, 6, 3);
        let plane = width * height;
        let noise = |at: usize| ((at as u32).wrapping_mul(2_654_435_761) >> 20) as f32 / 4096.0;
        let coverage: Vec<f32> =
            (0..views * plane).map(|at| if noise(at + 999) < 0.6 { 1.0 } else { noise(at) }).collect();
        let premultiplied = |at: usize| noise(3 * at) * coverage[at / (3 * plane) * plane + at % plane];
        let mut colour: Vec<f32> = (0..3 * views * plane).map(premultiplied).collect();
        let original = colour.clone();
        let cell = |at: usize| {
            let seen: Vec<usize> = (0..views).filter(|view| coverage[view * plane + at] > 0.5).collect();
            let channel = |c: usize| {
                let value = |&v: &usize| f64::from(original[(3 * v + c) * plane + at] / coverage[v * plane + at]);
                let mean = seen.iter().map(value).sum::<f64>() / seen.len() as f64;
                seen.iter().map(value).map(|value| (value - mean).powi(2)).sum::<f64>()
            };
            (seen.len() >= 2).then(|| (0..3).map(channel).sum::<f64>() / (3 * (seen.len() - 1)) as f64)
        };
        for window in [3, 5] {
            let mut found = vec![0.0; plane];
            window_variance(&mut colour.clone(), &coverage, width, (window, 7.0), &mut found);
            for (at, &found) in found.iter().enumerate() {
                let near = |other: &usize| {
                    (other / width).abs_diff(at / width) <= window / 2
                        && (other % width).abs_diff(at % width) <= window / 2
                };
                let of_window: Vec<f64> = (0..plane).filter(near).filter_map(cell).collect();
                let expected = of_window.iter().sum::<f64>() / of_window.len() as f64;
                assert!((f64::from(found) - expected).abs() < 1e-6, "{at}: {found}, not {expected}");
            }
        }
        let mut found = vec![0.0; plane];
        window_variance(&mut colour, &vec![0.5; views * plane], width, (3, 7.0), &mut found);
        assert_eq!(found, vec![7.0; plane], "half a cell is not covered");
    }

    #[test]
    fn winner_is_the_nearer_of_equals_and_lies_on_the_parabola() {
        let maps = Array3::from_shape_vec((4, 1, 1), vec![0.8, 0.6, 0.5, 0.4]).unwrap();
        let found = |costs: [f32; 4]| {
            winner_takes_all(Array3::from_shape_vec((4, 1, 1), costs.to_vec()).unwrap().view(), maps.view())[(0, 0)]
        };
        assert_eq!([found([1.0, 1.0, 1.0, 1.0]), found([2.0, 2.0, 2.0, 1.0])], [0.8, 0.4]);
        // Vertices at −1/4 and +1/4 of a layer: each towards the map on that side.
        assert!((found([2.0, 1.0, 4.0, 9.0]) - (0.6 + 0.25 * 0.2)).abs() < 1e-6, "{}", found([2.0, 1.0, 4.0, 9.0]));
        assert!((found([9.0, 4.0, 1.0, 2.0]) - (0.5 - 0.25 * 0.1)).abs() < 1e-6);
        assert_eq!(found([2.0, 1.0, 1.0, 2.0]), 0.6 + 0.5 * (0.5 - 0.6));
    }
}
