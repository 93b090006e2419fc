//! How little the views that see a pixel agree about it: the variance of their colours, over a window.
//!
//! Of the views with a coverage above 0.5 and a visibility of 1 (two at least): Σ (c − mean)² over views and channels, divided by
//! 3·(n − 1), computed as (Σ c² − (Σ c)²/n); c is the sample divided by its coverage, times the view's gain, less 0.5. With fewer
//! views, and above: 0.02. Then the mean over a window of 7×7 pixels, clipped to the map.

use rayon::prelude::*;

use crate::warp::{NO_GAINS, RUN, RunCoverage, SamplePositions, WarpSource, sample};

/// What a pixel costs that fewer than two views see, and the most that any costs.
pub(crate) const MOST: f32 = 0.02;
/// What colours are measured from.
const GREY: f32 = 0.5;
/// Radius of the window, pixels.
const RADIUS: usize = 3;
/// Rows that a thread takes at a time.
const BAND: usize = 16;

/// The views at the target: their photos, and which pixels of the surface they see (1 or 0, `[V][h·w]`).
pub(crate) struct Views<'a> {
    pub(crate) sources: &'a [WarpSource<'a>],
    pub(crate) visible: &'a [Vec<f32>],
}

/// Disagreement `[h·w]` on `surface` (row by row, `width` wide, a multiple of 8) at the pixels whose `asked` is below 0; 0 elsewhere.
pub(crate) fn photo_variance(views: &Views<'_>, surface: &[f32], width: usize, asked: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0; surface.len()];
    let bands = out.par_chunks_mut(BAND * width).enumerate();
    let map = Map { surface, asked, width, height: surface.len() / width };
    bands.for_each_init(
        || Scratch::new(width),
        |scratch, (index, rows)| window_rows(views, &map, index * BAND, scratch, rows),
    );
    out
}

/// A surface, and where it is asked about.
struct Map<'a> {
    surface: &'a [f32],
    asked: &'a [f32],
    width: usize,
    height: usize,
}

impl Map<'_> {
    /// Whether a pixel of these rows and columns is asked about.
    fn asks(&self, mut rows: std::ops::Range<usize>, columns: std::ops::Range<usize>) -> bool {
        let columns = columns.start..columns.end.min(self.width);
        rows.any(|y| y < self.height && self.asked[y * self.width..][columns.clone()].iter().any(|&asked| asked < 0.0))
    }
}

struct Scratch {
    values: Vec<f32>,
    sums: Vec<f32>,
    taps: SamplePositions,
}

impl Scratch {
    fn new(width: usize) -> Self {
        let stride = width.next_multiple_of(RUN);
        Self {
            values: vec![0.0; (BAND + 2 * RADIUS) * stride],
            sums: vec![0.0; stride + 2 * RUN],
            taps: SamplePositions::NONE,
        }
    }
}

#[pulp::with_simd(window_rows = crate::simd::arch())]
#[inline(always)]
fn window_rows_with<'a, S: pulp::Simd>(
    simd: S,
    views: &'a Views<'a>,
    map: &'a Map<'a>,
    first: usize,
    scratch: &'a mut Scratch,
    out: &'a mut [f32],
) {
    let Map { surface, asked, width, height } = *map;
    let stride = width.next_multiple_of(RUN);
    let rows = out.len() / width;
    let (begin, end) = (first.saturating_sub(RADIUS), (first + rows + RADIUS).min(height));
    for start in (0..width).step_by(RUN) {
        if !map.asks(begin..end, start.saturating_sub(RADIUS)..start + RUN + RADIUS) {
            continue;
        }
        for y in begin..end {
            let wide = RUN.min(width - start);
            let span = y * width + start..y * width + start + wide;
            let mut disparity = [0.0; RUN];
            disparity[..wide].copy_from_slice(&surface[span.clone()]);
            let last = disparity[wide - 1];
            disparity[wide..].fill(last);
            let mut sums = [[0.0_f32; RUN]; 3];
            let (mut squares, mut number) = ([0.0_f32; RUN], [0.0_f32; RUN]);
            for (source, visible) in views.sources.iter().zip(views.visible) {
                let found = scratch.taps.find(source, y, &(start..start + RUN), &disparity);
                if found == RunCoverage::None {
                    continue;
                }
                let mut samples = [[0.0; RUN]; 4];
                sample(simd, source.texture, &scratch.taps, NO_GAINS, samples.each_mut());
                let mut weight = [0.0; RUN];
                weight[..wide].copy_from_slice(&visible[span.clone()]);
                let [red, green, blue, coverage] = &samples;
                let gains = source.gains;
                for i in 0..RUN {
                    let seen = coverage[i] > 0.5;
                    let w = if seen { weight[i] } else { 0.0 };
                    let share = w / if seen { coverage[i] } else { 1.0 };
                    // Less a grey, which changes no variance but spares half its digits in the difference below.
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
            let values: &mut [f32; RUN] =
                (&mut scratch.values[(y - begin) * stride + start..][..RUN]).try_into().expect("a run");
            for i in 0..RUN {
                let n = if number[i] > 1.0 { number[i] } else { 1.0 };
                let mean = ((sums[0][i] * sums[0][i] + sums[1][i] * sums[1][i]) + sums[2][i] * sums[2][i]) / n;
                let less = if number[i] > 2.0 { number[i] - 1.0 } else { 1.0 };
                let variance = (squares[i] - mean) / (3.0 * less);
                let variance = if number[i] > 1.5 { variance } else { MOST };
                let variance = if variance < MOST { variance } else { MOST };
                values[i] = if variance > 0.0 { variance } else { 0.0 };
            }
        }
    }
    for (row, out) in out.chunks_exact_mut(width).enumerate() {
        let y = first + row;
        let asked = &asked[y * width..(y + 1) * width];
        if asked.iter().all(|&asked| asked >= 0.0) {
            continue;
        }
        let (top, bottom) = (y.saturating_sub(RADIUS), (y + RADIUS + 1).min(height));
        let sums = &mut scratch.sums[RADIUS..RADIUS + width];
        sums.fill(0.0);
        for y in top..bottom {
            let values = &scratch.values[(y - begin) * stride..][..width];
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        }
        scratch.sums[..RADIUS].fill(0.0);
        scratch.sums[RADIUS + width..][..RADIUS].fill(0.0);
        for x in (0..width).filter(|&x| asked[x] < 0.0) {
            let total = scratch.sums[x..=x + 2 * RADIUS].iter().fold(0.0, |total, sum| total + sum);
            let columns = (x + RADIUS + 1).min(width) - x.saturating_sub(RADIUS);
            out[x] = total / ((bottom - top) * columns) as f32;
        }
    }
}
