//! The target's own search of its holes, which starts from what the photos confirm.
//!
//! On cells of 4×4 pixels: photos are averaged, the views' confirmed depths and the splat are
//! medians of what a cell holds (at least 4 pixels; the farther of the two in the middle). Planes
//! are 3 px of parallax apart, from near to far, 8 to 192 of them. The cost of a plane at a cell is
//! the sum of
//!
//! - the variance of the colours of the views that see it ([`visible`], coverage above 0.5),
//!   averaged over the cells of a 5×5 window that two views see; 0.02 where there are none;
//! - 0.01 for each view that sees past it;
//! - where the splat has disparity d, 0.07·min(|d − δ|/(4 planes), 1): anchors, from which the paths
//!   carry the depth into the holes.
//!
//! Aggregated along four paths ([`semi_global`]; step 0.004, jump 0.4); the plane of least cost,
//! refined by a parabola; 3×3 median; enlarged bilinearly. Measured alternatives:
//! docs/design-log/ordinary-scenes.md.
//!
//! What the search finds and what fills a hole from its neighbours are compared by the variance of the
//! colours of the photos that see a pixel ([`photo_variance`]). Of the n views with a coverage above 0.5 and a visibility of 1 (at least two): Σ (c − mean)²
//! over views and channels, divided by 3·(n − 1), computed as (Σ c² − (Σ c)²/n); c is the sample
//! divided by its coverage, times the view's gain, less 0.5. At most 0.02, which is also the value
//! with fewer views, and where a view sees past the surface. Then the mean over
//! a window of 7×7 pixels, clipped to the map.

use ndarray::{Array2, Array3, ArrayView3};
use rayon::prelude::*;

use crate::ConfirmedDisparity;
use crate::consistency::visible;
use crate::fusion::SurfaceView;
use crate::matching::{Penalties, semi_global, window_variance, winner_takes_all};
use crate::neighbourhood::median3;
use crate::parallax::widest_parallax;
use liveview::geometry::{Camera, PlaneSweep, Size};
use liveview::layers::{enlarge, uniform_disparities};
use liveview::warp::{NO_GAINS, RUN, RunCoverage, SamplePositions, Texture, WarpSource, sample, warp_layers};

/// Target pixels per side of a cell.
const CELL: usize = 4;
/// Pixels with a depth that give their cell one.
const MIN_CONFIRMED: usize = 4;
/// Distance between the planes, px of parallax, and their number.
const PLANE_SPACING_PX: f64 = 3.0;
const PLANE_COUNT: std::ops::RangeInclusive<usize> = 8..=192;
/// Side of the window of the variance, cells, and its value where fewer than two views see any.
const WINDOW: (usize, f32) = (5, 0.02);
/// Cost of a view that sees past.
const PAST_COST: f32 = 0.01;
/// Cost of a plane far from the anchor, and the distance from which on it is paid, planes.
const ANCHOR_COST: f32 = 0.07;
const ANCHOR_REACH: f32 = 4.0;
const PENALTIES: Penalties = Penalties { step: 0.004, jump: 0.4 };

/// What the target is searched from.
pub(crate) struct TargetSearch<'a> {
    pub(crate) views: &'a [SurfaceView<'a>],
    /// The views for the warp to the target.
    pub(crate) sources: &'a [WarpSource<'a>],
    pub(crate) target: &'a Camera,
    /// The splat of the confirmed depths, row by row; −1 in holes.
    pub(crate) splatted: &'a [f32],
    /// That of the splat: the padded target, pixels.
    pub(crate) size: Size,
    /// Near and far, scene units.
    pub(crate) range: (f64, f64),
    /// How much nearer or farther a view's own depth must be to hide or to rule out a point, 1/scene
    /// unit.
    pub(crate) margin: f32,
}

impl TargetSearch<'_> {
    /// Disparity of each pixel of the target, row by row, at these costs of the planes.
    pub(crate) fn disparity(&self, planes: &[f32], costs: ArrayView3<'_, f32>) -> Vec<f32> {
        let sums = semi_global(costs, PENALTIES);
        let planes = ArrayView3::from_shape((planes.len(), 1, 1), planes).expect("one per plane");
        let found = winner_takes_all(sums.view(), planes.broadcast(sums.dim()).expect("one per cell"));
        let smooth = median3(found.as_slice().expect("standard order"), found.ncols());
        let smooth = Array2::from_shape_vec(found.dim(), smooth).expect("one per cell");
        let mut disparity = vec![0.0; self.size.pixels()];
        enlarge(smooth.view(), CELL, self.size.width, &mut disparity);
        disparity
    }

    /// Disparities `[D]`, near → far.
    pub(crate) fn planes(&self) -> Vec<f32> {
        let (near, far) = self.range;
        let sweeps: Vec<PlaneSweep> = self.sources.iter().map(|source| source.sweep).collect();
        let count = (widest_parallax(&sweeps, self.size, near, far) / PLANE_SPACING_PX).ceil() as usize + 1;
        let planes = uniform_disparities(near, far, count.clamp(*PLANE_COUNT.start(), *PLANE_COUNT.end()));
        planes.expect("near < far").into_iter().map(|disparity| disparity as f32).collect()
    }

    /// Costs `[D, h, w]` of the planes at the cells.
    pub(crate) fn costs(&self, planes: &[f32]) -> Array3<f32> {
        let (near, far) = self.range;
        let step = (1.0 / near - 1.0 / far) / (planes.len() - 1) as f64;
        let reach = ANCHOR_REACH * step as f32;
        let textures: Vec<Texture> = self.sources.par_iter().map(|source| source.texture.shrunk(CELL)).collect();
        let shrunk = |(source, texture): (&WarpSource<'_>, _)| {
            let sweep = source.sweep.shrunk(CELL as f64);
            WarpSource { texture, sweep, gains: source.gains }
        };
        let sources: Vec<_> = self.sources.iter().zip(&textures).map(shrunk).collect();
        let confirmed = |view: &SurfaceView<'_>| {
            let ConfirmedDisparity { disparity, disparity_per_pixel } = view.confirmed;
            let disparity = cell_medians(disparity.as_slice().expect("standard order"), disparity.ncols());
            (view.view.camera.shrunk(CELL), ConfirmedDisparity { disparity, disparity_per_pixel: *disparity_per_pixel })
        };
        let maps: Vec<(Camera, ConfirmedDisparity)> = self.views.par_iter().map(confirmed).collect();
        let (target, anchors) = (self.target.shrunk(CELL), cell_medians(self.splatted, self.size.width));
        let cells = Size::new(self.size.width / CELL, self.size.height / CELL);
        let mut costs = Array3::zeros((planes.len(), cells.height, cells.width));
        let by_plane = costs.as_slice_mut().expect("standard order").par_chunks_mut(cells.pixels());
        by_plane.zip(planes).for_each(|(costs, &disparity)| {
            let map = vec![disparity; cells.pixels()];
            let mut colour = vec![0.0; 3 * sources.len() * cells.pixels()];
            let mut coverage = vec![0.0; sources.len() * cells.pixels()];
            warp_layers(&map, &sources, cells, &mut colour, &mut coverage);
            let mut past = vec![0.0; cells.pixels()];
            for ((camera, confirmed), coverage) in maps.iter().zip(coverage.chunks_exact_mut(cells.pixels())) {
                let seen = visible((camera, confirmed), &target, &map, cells.width, self.margin);
                for ((coverage, seen), past) in coverage.iter_mut().zip(seen).zip(&mut past) {
                    *past += if (seen < 0.0) & (*coverage > 0.5) { PAST_COST } else { 0.0 };
                    *coverage = if seen > 0.0 { *coverage } else { 0.0 };
                }
            }
            window_variance(&mut colour, &coverage, cells.width, WINDOW, costs);
            for ((cost, past), &anchor) in costs.iter_mut().zip(&past).zip(&anchors) {
                let share = ((anchor - disparity).abs() / reach).min(1.0);
                *cost += *past + if anchor >= 0.0 { ANCHOR_COST * share } else { 0.0 };
            }
        });
        costs
    }
}

/// The median of the values of each cell (−1: none), rows `width` wide; −1 where a cell has too few.
fn cell_medians(map: &[f32], width: usize) -> Array2<f32> {
    let height = map.len() / width;
    let mut medians = Array2::from_elem((height.div_ceil(CELL), width.div_ceil(CELL)), -1.0);
    let columns = medians.ncols();
    let rows = medians.as_slice_mut().expect("standard order").par_chunks_mut(columns).enumerate();
    rows.for_each(|(row, medians)| {
        let lines = row * CELL..((row + 1) * CELL).min(height);
        for (column, median) in medians.iter_mut().enumerate() {
            let span = column * CELL..((column + 1) * CELL).min(width);
            let mut values = [0.0; CELL * CELL];
            let mut count = 0;
            for &value in lines.clone().flat_map(|y| &map[y * width..][span.clone()]) {
                values[count] = value;
                count += usize::from(value >= 0.0);
            }
            if count >= MIN_CONFIRMED {
                let middle = count / 2;
                *median = *values[..count].select_nth_unstable_by(middle, |a, b| b.total_cmp(a)).1;
            }
        }
    });
    medians
}

/// Upper bound of the variance, and its value where fewer than two views see the pixel, or one sees
/// past it.
pub(crate) const MAX_VARIANCE: f32 = 0.02;
/// Subtracted from the colours: it changes no variance but spares half of the digits that
/// Σ c² − (Σ c)²/n would cancel.
const GREY: f32 = 0.5;
/// Radius of the window, pixels.
const WINDOW_RADIUS: usize = 3;
/// Rows that one task processes at a time.
const BAND_ROWS: usize = 16;

/// A surface of the target, and the views that see it.
pub(crate) struct SeenSurface<'a> {
    /// Disparity of each pixel, row by row, 1/scene unit.
    pub(crate) disparity: &'a [f32],
    /// The disparity carried over from the photos, before holes were filled; below 0 in holes.
    pub(crate) splatted: &'a [f32],
    /// Pixels per row, a multiple of 8.
    pub(crate) width: usize,
    /// The views for the warp to the target.
    pub(crate) sources: &'a [WarpSource<'a>],
    /// Which pixels of the surface each view sees (1 or 0) or sees past (−1), `[V][h·w]`.
    pub(crate) visible: &'a [Vec<f32>],
}

/// Variance `[h·w]` of the photos' colours in the holes of a surface; 0 elsewhere.
pub(crate) fn photo_variance(surface: &SeenSurface<'_>) -> Vec<f32> {
    let mut out = vec![0.0; surface.disparity.len()];
    let bands = out.par_chunks_mut(BAND_ROWS * surface.width).enumerate();
    bands.for_each_init(
        || Scratch::new(surface.width),
        |scratch, (index, rows)| band_variance(surface, index * BAND_ROWS, scratch, rows),
    );
    out
}

impl SeenSurface<'_> {
    fn height(&self) -> usize {
        self.disparity.len() / self.width
    }

    /// Whether a pixel of these rows and columns is a hole.
    fn has_holes(&self, mut rows: std::ops::Range<usize>, columns: std::ops::Range<usize>) -> bool {
        let columns = columns.start..columns.end.min(self.width);
        let is_hole = |&disparity: &f32| disparity < 0.0;
        rows.any(|y| y < self.height() && self.splatted[y * self.width..][columns.clone()].iter().any(is_hole))
    }
}

struct Scratch {
    /// Variances of a band's rows and those that its windows reach.
    variances: Vec<f32>,
    /// Sums of their columns over the rows of a window.
    column_sums: Vec<f32>,
    positions: SamplePositions,
}

impl Scratch {
    fn new(width: usize) -> Self {
        let stride = width.next_multiple_of(RUN);
        Self {
            variances: vec![0.0; (BAND_ROWS + 2 * WINDOW_RADIUS) * stride],
            column_sums: vec![0.0; stride + 2 * RUN],
            positions: SamplePositions::NEW,
        }
    }
}

#[pulp::with_simd(band_variance = liveview::simd::arch())]
#[inline(always)]
fn band_variance_with<'a, S: pulp::Simd>(
    simd: S,
    surface: &'a SeenSurface<'a>,
    first: usize,
    scratch: &'a mut Scratch,
    out: &'a mut [f32],
) {
    let SeenSurface { disparity: map, splatted, width, sources, visible } = *surface;
    let height = surface.height();
    let stride = width.next_multiple_of(RUN);
    let rows = out.len() / width;
    let (begin, end) = (first.saturating_sub(WINDOW_RADIUS), (first + rows + WINDOW_RADIUS).min(height));
    for start in (0..width).step_by(RUN) {
        if !surface.has_holes(begin..end, start.saturating_sub(WINDOW_RADIUS)..start + RUN + WINDOW_RADIUS) {
            continue;
        }
        for y in begin..end {
            let length = RUN.min(width - start);
            let span = y * width + start..y * width + start + length;
            let mut disparity = [0.0; RUN];
            disparity[..length].copy_from_slice(&map[span.clone()]);
            let last = disparity[length - 1];
            disparity[length..].fill(last);
            let mut sums = [[0.0_f32; RUN]; 3];
            let (mut squares, mut number, mut past) = ([0.0_f32; RUN], [0.0_f32; RUN], [false; RUN]);
            for (source, visible) in sources.iter().zip(visible) {
                let run_coverage = scratch.positions.locate::<false>(source, y, &(start..start + RUN), &disparity);
                if run_coverage == RunCoverage::None {
                    continue;
                }
                let mut samples = [[0.0; RUN]; 4];
                sample(simd, source.texture, &scratch.positions, NO_GAINS, samples.each_mut());
                let mut weight = [0.0; RUN];
                weight[..length].copy_from_slice(&visible[span.clone()]);
                let [red, green, blue, coverage] = &samples;
                let gains = source.gains;
                for i in 0..RUN {
                    let seen = coverage[i] > 0.5;
                    let w = if seen & (weight[i] > 0.0) { weight[i] } else { 0.0 };
                    past[i] |= seen & (weight[i] < 0.0);
                    let share = w / if seen { coverage[i] } else { 1.0 };
                    let grey = GREY * w;
                    let r = red[i] * share * gains[0] - grey;
                    let g = green[i] * share * gains[1] - grey;
                    let b = blue[i] * share * gains[2] - grey;
                    sums[0][i] += r;
                    sums[1][i] += g;
                    sums[2][i] += b;
                    squares[i] += (r * r + g * g) + b * b;
                    number[i] += w;
                }
            }
            let variances: &mut [f32; RUN] =
                (&mut scratch.variances[(y - begin) * stride + start..][..RUN]).try_into().expect("a run");
            for i in 0..RUN {
                let n = if number[i] > 1.0 { number[i] } else { 1.0 };
                let mean = ((sums[0][i] * sums[0][i] + sums[1][i] * sums[1][i]) + sums[2][i] * sums[2][i]) / n;
                let degrees = if number[i] > 2.0 { number[i] - 1.0 } else { 1.0 };
                let variance = (squares[i] - mean) / (3.0 * degrees);
                let variance = if (number[i] > 1.5) & !past[i] { variance } else { MAX_VARIANCE };
                let variance = if variance < MAX_VARIANCE { variance } else { MAX_VARIANCE };
                variances[i] = if variance > 0.0 { variance } else { 0.0 };
            }
        }
    }
    for (row, out) in out.chunks_exact_mut(width).enumerate() {
        let y = first + row;
        let splatted = &splatted[y * width..(y + 1) * width];
        if splatted.iter().all(|&disparity| disparity >= 0.0) {
            continue;
        }
        let (top, bottom) = (y.saturating_sub(WINDOW_RADIUS), (y + WINDOW_RADIUS + 1).min(height));
        let sums = &mut scratch.column_sums[WINDOW_RADIUS..WINDOW_RADIUS + width];
        sums.fill(0.0);
        for y in top..bottom {
            let variances = &scratch.variances[(y - begin) * stride..][..width];
            sums.iter_mut().zip(variances).for_each(|(sum, value)| *sum += value);
        }
        scratch.column_sums[..WINDOW_RADIUS].fill(0.0);
        scratch.column_sums[WINDOW_RADIUS + width..][..WINDOW_RADIUS].fill(0.0);
        for x in (0..width).filter(|&x| splatted[x] < 0.0) {
            let total = scratch.column_sums[x..=x + 2 * WINDOW_RADIUS].iter().fold(0.0, |total, sum| total + sum);
            let columns = (x + WINDOW_RADIUS + 1).min(width) - x.saturating_sub(WINDOW_RADIUS);
            out[x] = total / ((bottom - top) * columns) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cell_medians_need_four_values_and_take_the_farther_of_the_middle_two() {
        let mut map = vec![-1.0; 6 * 5];
        let values = [(0, 0, 4.0), (1, 1, 1.0), (2, 3, 3.0), (3, 2, 2.0), (0, 4, 7.0), (1, 5, 7.0), (2, 4, 7.0)];
        values.into_iter().for_each(|(y, x, value)| map[y * 6 + x] = value);
        (0..6).for_each(|x| map[4 * 6 + x] = 0.0);
        let medians = cell_medians(&map, 6);
        assert_eq!(medians, ndarray::arr2(&[[2.0, -1.0], [0.0, -1.0]]));
    }

    #[test]
    fn costs_of_planes_that_views_see_past_and_of_anchors() {
        let intrinsics = liveview::geometry::Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 16.0, skew: 0.0 };
        let camera = Camera::new(intrinsics, 64, 32, glam::DMat3::IDENTITY, glam::DVec3::ZERO).unwrap();
        let photo = Texture::new(&liveview::image::ImageRgb::new(64, 32, vec![0.5; 3 * 64 * 32]).unwrap());
        let confirmed = [0.1, 0.1, -1.0]
            .map(|d| ConfirmedDisparity { disparity: Array2::from_elem((32, 64), d), disparity_per_pixel: 0.01 });
        let view = liveview::warp::SourceView { camera: &camera, texture: &photo };
        let views: Vec<_> =
            confirmed.iter().map(|confirmed| SurfaceView { view, confirmed, gains: NO_GAINS }).collect();
        let sources = crate::fusion::warp_sources(&views, &camera);
        // Anchors on the right half.
        let splatted: Vec<f32> = (0..64 * 32).map(|at| if at % 64 < 32 { -1.0 } else { 0.5 }).collect();
        let search = TargetSearch {
            views: &views,
            sources: &sources,
            target: &camera,
            splatted: &splatted,
            size: Size::new(64, 32),
            range: (1.0, 8.0),
            margin: 0.05,
        };
        let planes = search.planes();
        assert_eq!(planes, [1.0, 0.875, 0.75, 0.625, 0.5, 0.375, 0.25, 0.125]);
        for ((plane, _, x), &found) in search.costs(&planes).indexed_iter() {
            // Two views see past all planes but the last: the third alone has no variance.
            let seen = if plane == 7 { 0.0 } else { 0.02 + 2.0 * 0.01 };
            let anchor = if x < 8 { 0.0 } else { 0.07 * (plane.abs_diff(4) as f32 / 4.0).min(1.0) };
            assert!((found - seen - anchor).abs() < 1e-6, "plane {plane}, column {x}: {found}");
        }
    }
}
