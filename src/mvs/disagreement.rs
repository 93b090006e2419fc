//! How little the views that see a pixel agree about it: the variance of their colours, over a window.
//!
//! Of the views with a coverage above 0.5 and a visibility of 1 (two at least): Σ (c − mean)² over views and channels, divided by
//! 3·(n − 1), computed as (Σ c² − (Σ c)²/n); c is the sample divided by its coverage, less 0.5. With fewer views, and above: 0.02.
//! Then the mean over a window of (2·radius + 1)² pixels, clipped to the map.

use rayon::prelude::*;

use super::{RUN, RunCoverage, SamplePositions, WarpSource, sample};

/// What a pixel costs that fewer than two views see, and the most that any costs.
pub(super) const MOST: f32 = 0.02;
/// What colours are measured from.
const GREY: f32 = 0.5;
/// Rows that a thread takes at a time.
const BAND: usize = 16;

/// The views at the target: their photos, and which pixels of the surface they see (1 or 0, `[V][h·w]`).
pub(super) struct Views<'a> {
    pub(super) sources: &'a [WarpSource<'a>],
    pub(super) visible: &'a [Vec<f32>],
}

/// Disagreement on `surface` (row by row, `width` wide, a multiple of 8) moved by each of `offsets`: `[offsets][h·w]`.
pub(super) fn disagreement(
    views: &Views<'_>,
    surface: &[f32],
    width: usize,
    offsets: &[f32],
    radius: usize,
) -> Vec<Vec<f32>> {
    let mut out = vec![vec![0.0; surface.len()]; offsets.len()];
    let mut bands: Vec<Vec<&mut [f32]>> = (0..surface.len().div_ceil(BAND * width)).map(|_| Vec::new()).collect();
    for plane in &mut out {
        plane.chunks_mut(BAND * width).zip(&mut bands).for_each(|(rows, band)| band.push(rows));
    }
    let size = (surface.len() / width, width);
    bands.into_par_iter().enumerate().for_each_init(
        || Scratch::new(width, radius),
        |scratch, (index, mut band)| {
            for (&offset, rows) in offsets.iter().zip(&mut band) {
                window_rows(views, (surface, size), offset, (index * BAND, radius), scratch, rows);
            }
        },
    );
    out
}

struct Scratch {
    values: Vec<f32>,
    sums: Vec<f32>,
    taps: SamplePositions,
}

impl Scratch {
    fn new(width: usize, radius: usize) -> Self {
        let stride = width.next_multiple_of(RUN);
        Self {
            values: vec![0.0; (BAND + 2 * radius) * stride],
            sums: vec![0.0; stride + 2 * RUN],
            taps: SamplePositions::NONE,
        }
    }
}

#[pulp::with_simd(window_rows = pulp::Arch::new())]
#[inline(always)]
fn window_rows_with<'a, S: pulp::Simd>(
    simd: S,
    views: &'a Views<'a>,
    (surface, (height, width)): (&'a [f32], (usize, usize)),
    offset: f32,
    (first, radius): (usize, usize),
    scratch: &'a mut Scratch,
    out: &'a mut [f32],
) {
    let stride = width.next_multiple_of(RUN);
    let rows = out.len() / width;
    let (begin, end) = (first.saturating_sub(radius), (first + rows + radius).min(height));
    for y in begin..end {
        for start in (0..width).step_by(RUN) {
            let wide = RUN.min(width - start);
            let span = y * width + start..y * width + start + wide;
            let mut disparity = [0.0; RUN];
            disparity[..wide].copy_from_slice(&surface[span.clone()]);
            let last = disparity[wide - 1];
            disparity[wide..].fill(last);
            for d in &mut disparity {
                let moved = *d + offset;
                *d = if moved > 0.0 { moved } else { 0.0 };
            }
            let mut sums = [[0.0_f32; RUN]; 3];
            let (mut squares, mut number) = ([0.0_f32; RUN], [0.0_f32; RUN]);
            for (source, visible) in views.sources.iter().zip(views.visible) {
                let found = scratch.taps.find(source, y, &(start..start + RUN), &disparity);
                if found == RunCoverage::None {
                    continue;
                }
                let mut samples = [[0.0; RUN]; 4];
                sample(simd, source.texture, &scratch.taps, samples.each_mut());
                let mut weight = [0.0; RUN];
                weight[..wide].copy_from_slice(&visible[span.clone()]);
                let [red, green, blue, coverage] = &samples;
                for i in 0..RUN {
                    let seen = coverage[i] > 0.5;
                    let w = if seen { weight[i] } else { 0.0 };
                    let share = w / if seen { coverage[i] } else { 1.0 };
                    // Less a grey, which changes no variance but spares half its digits in the difference below.
                    let grey = GREY * w;
                    let (r, g, b) = (red[i] * share - grey, green[i] * share - grey, blue[i] * share - grey);
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
        let (top, bottom) = (y.saturating_sub(radius), (y + radius + 1).min(height));
        let sums = &mut scratch.sums[radius..radius + width];
        sums.fill(0.0);
        for y in top..bottom {
            let values = &scratch.values[(y - begin) * stride..][..width];
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        }
        scratch.sums[..radius].fill(0.0);
        scratch.sums[radius + width..][..radius].fill(0.0);
        let size = 2 * radius + 1;
        let rows = (bottom - top) as f32;
        for (x, out) in out.iter_mut().enumerate() {
            let mut total = scratch.sums[x];
            for i in 1..size {
                total += scratch.sums[x + i];
            }
            let columns = (x + radius + 1).min(width) - x.saturating_sub(radius);
            *out = total / (rows * columns as f32);
        }
    }
}
