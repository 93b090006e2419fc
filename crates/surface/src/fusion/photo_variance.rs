//! Photo-consistency of a surface: the variance of the colours of the photos that see a pixel, over
//! a window.
//!
//! Of the n views with a coverage above 0.5 and a visibility of 1 (at least two): Σ (c − mean)²
//! over views and channels, divided by 3·(n − 1), computed as (Σ c² − (Σ c)²/n); c is the sample
//! divided by its coverage, times the view's gain, less 0.5. At most 0.02, which is also the value
//! with fewer views, and where a view sees past the surface. Then the mean over a window of 7×7 pixels, clipped to the map.

use rayon::prelude::*;

use liveview::warp::{NO_GAINS, RUN, RunCoverage, SamplePositions, WarpSource, sample};

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
