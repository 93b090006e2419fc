//! The depth of a photo at its edges, moved to the nearer side where other photos show it.
//!
//! Beside an edge, a search gives some pixels of the near surface the depth of the background, and
//! pictures show their colour on the background. The opposite error costs less: a pixel of the
//! background with the near depth is left out, and other photos show the background
//! (docs/design-log/photo-depth-edges.md).
//!
//! The depths of the other photos are splatted to the photo ([`splat`]); only those count that
//! two of them have. Such a depth replaces the photo's own where it is nearer by more than 2 px and
//!
//! - the photo's own depth differs by more than 3 px within 5×5 pixels: there is an edge;
//! - other photos confirm more than half of the 31×31 pixels around: their depths are trusted;
//! - its colour cost is not higher. The difference from another photo is the mean of the channels, at
//!   most 0.2, and 0.2 outside that photo; averaged over 3×3 pixels, each at its own disparity (the
//!   photo's own where two others have none). The cost is the mean of the lowest two.
//!
//! px is the photo's disparity per pixel.

use std::ops::Range;

use rayon::prelude::*;

use crate::fusion::{AVERAGED_PX, SAME_SURFACE_PX, Single, splat};
use crate::neighbourhood::share_of_known;
use crate::{ConfirmedDisparity, PhotoDisparity};
use liveview::geometry::Size;
use liveview::warp::{NO_GAINS, RUN, SamplePositions, SourceView, Texture, WarpSource, sample, warp_sources};

/// The photo's own depth differs by more than this at an edge, px, within [`EDGE_RADIUS`] pixels.
const EDGE_PX: f32 = 3.0;
const EDGE_RADIUS: usize = 2;
/// Share of the pixels within [`WINDOW_RADIUS`] that other photos confirm.
const MIN_CONFIRMED: f32 = 0.5;
const WINDOW_RADIUS: usize = 15;
/// Upper bound of a difference of colour.
const MAX_DIFFERENCE: f32 = 0.2;
/// Coverage of a sample inside the photo; positions are exact to some millionths of a pixel.
const INSIDE: f32 = 1.0 - 1e-4;

/// The depth of photo `which` of a set, moved to the nearer side at edges; `confirmed` is what the
/// others of the set confirm of it.
pub fn nearer_edges(
    set: &[(SourceView<'_>, &PhotoDisparity)],
    which: usize,
    confirmed: &ConfirmedDisparity,
) -> PhotoDisparity {
    let (view, depth) = set[which];
    let (size, px) = (view.camera.size(), depth.disparity_per_pixel);
    let others = || set.iter().enumerate().filter(|&(index, _)| index != which).map(|(_, other)| other);
    let maps: Vec<_> = others().map(|(other, depth)| (other.camera, &depth.disparity)).collect();
    let nearer = splat(&maps, view.camera, size, (SAME_SURFACE_PX * px, AVERAGED_PX * px), Single::LeftOut);
    let views: Vec<SourceView<'_>> = others().map(|&(other, _)| other).collect();
    let sources = warp_sources(&views, view.camera);
    let confirmed = share_of_known(&confirmed.disparity, WINDOW_RADIUS);
    let own = depth.disparity.as_slice().expect("standard order");
    let is_candidate = |at: usize| {
        let (x, y) = (at % size.width, at / size.width);
        nearer[at] > own[at] + SAME_SURFACE_PX * px
            && confirmed((y, x)) > MIN_CONFIRMED
            && is_edge(own, size.width, (x, y), EDGE_PX * px)
    };
    let candidates: Vec<usize> = (0..own.len()).into_par_iter().filter(|&at| is_candidate(at)).collect();
    let mut disparity = depth.disparity.clone();
    if candidates.is_empty() {
        return PhotoDisparity { disparity, disparity_per_pixel: px };
    }
    let filled: Vec<f32> =
        nearer.iter().zip(own).map(|(&nearer, &own)| if nearer < 0.0 { own } else { nearer }).collect();
    let runs = runs_around(&candidates, size);
    let costs = |map: &[f32]| -> Vec<f32> {
        let differences = |source| differences(view.texture, source, map, &runs, size);
        let differences: Vec<Vec<f32>> = sources.par_iter().map(differences).collect();
        candidates.par_iter().map(|&at| cost(&differences, at, size)).collect()
    };
    let values = disparity.as_slice_mut().expect("standard order");
    for (&at, (nearer_cost, own_cost)) in candidates.iter().zip(costs(&filled).into_iter().zip(costs(own))) {
        if nearer_cost <= own_cost {
            values[at] = nearer[at];
        }
    }
    PhotoDisparity { disparity, disparity_per_pixel: px }
}

/// Whether disparities of a map with rows `width` wide differ by more than `least` within
/// [`EDGE_RADIUS`] pixels of a (column, row).
fn is_edge(map: &[f32], width: usize, (x, y): (usize, usize), least: f32) -> bool {
    let around = |at: usize, side: usize| at.saturating_sub(EDGE_RADIUS)..(at + EDGE_RADIUS + 1).min(side);
    let (mut largest, mut smallest) = (f32::MIN, f32::MAX);
    for row in around(y, map.len() / width) {
        for &disparity in &map[row * width..][around(x, width)] {
            (largest, smallest) = (largest.max(disparity), smallest.min(disparity));
        }
    }
    largest - smallest > least
}

/// Which runs of each row have a pixel beside one of these, `[h][⌈w / RUN⌉]`.
fn runs_around(pixels: &[usize], size: Size) -> Vec<bool> {
    let in_row = size.width.div_ceil(RUN);
    let mut runs = vec![false; size.height * in_row];
    for &at in pixels {
        let (columns, rows) = window(at, size);
        for row in rows {
            runs[row * in_row + columns.start / RUN..=row * in_row + (columns.end - 1) / RUN].fill(true);
        }
    }
    runs
}

/// Columns and rows of the 3×3 pixels around a pixel, inside the photo.
fn window(at: usize, size: Size) -> (Range<usize>, Range<usize>) {
    let around = |at: usize, side: usize| at.saturating_sub(1)..(at + 2).min(side);
    (around(at % size.width, size.width), around(at / size.width, size.height))
}

/// Mean of the lowest two of the photos' differences, each the mean of the 3×3 pixels around.
fn cost(differences: &[Vec<f32>], at: usize, size: Size) -> f32 {
    let (columns, rows) = window(at, size);
    let mut lowest = [MAX_DIFFERENCE; 2];
    for differences in differences {
        let row = |row: usize| differences[row * size.width..][columns.clone()].iter().sum::<f32>();
        let mean = rows.clone().map(row).sum::<f32>() / (columns.len() * rows.len()) as f32;
        if mean < lowest[0] {
            lowest = [mean, lowest[0]];
        } else if mean < lowest[1] {
            lowest[1] = mean;
        }
    }
    (lowest[0] + lowest[1]) / 2.0
}

/// Differences `[h·w]` of a photo's colours from another's along a map of disparities, in these runs;
/// elsewhere 0.
fn differences(photo: &Texture, other: &WarpSource<'_>, map: &[f32], runs: &[bool], size: Size) -> Vec<f32> {
    let mut out = vec![0.0; map.len()];
    let rows = out.par_chunks_mut(size.width).zip(map.par_chunks(size.width));
    let rows = rows.zip(runs.par_chunks(size.width.div_ceil(RUN))).enumerate();
    rows.for_each(|(y, ((out, map), runs))| difference_row(photo, other, y, map, runs, out));
    out
}

#[pulp::with_simd(difference_row = liveview::simd::arch())]
#[inline(always)]
fn difference_row_with<'a, S: pulp::Simd>(
    simd: S,
    photo: &'a Texture,
    other: &'a WarpSource<'a>,
    y: usize,
    map: &'a [f32],
    runs: &'a [bool],
    out: &'a mut [f32],
) {
    let mut positions = SamplePositions::NEW;
    let of_runs = map.chunks(RUN).zip(out.chunks_mut(RUN)).zip(runs).enumerate();
    for (run, ((map, out), _)) in of_runs.filter(|(_, (_, wanted))| **wanted) {
        let mut disparity = [map[map.len() - 1]; RUN];
        disparity[..map.len()].copy_from_slice(map);
        let start = run * RUN;
        positions.locate::<false>(other, y, &(start..start + RUN), &disparity);
        let mut samples = [[0.0; RUN]; 4];
        sample(simd, other.texture, &positions, NO_GAINS, samples.each_mut());
        let [red, green, blue, coverage] = &samples;
        for (i, out) in out.iter_mut().enumerate() {
            let own = photo.pixel(start + i, y);
            let difference = ((red[i] - own[0]).abs() + (green[i] - own[1]).abs() + (blue[i] - own[2]).abs()) / 3.0;
            let is_inside = (coverage[i] > INSIDE) & (difference < MAX_DIFFERENCE);
            *out = if is_inside { difference } else { MAX_DIFFERENCE };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_differs_by_more_than_the_least_within_two_pixels() {
        let mut map = vec![0.0; 9 * 9];
        map[4 * 9 + 4] = 0.5;
        let found = |least: f32| (0..81).filter(|at| is_edge(&map, 9, (at % 9, at / 9), least)).collect::<Vec<_>>();
        let near: Vec<usize> = (0..81).filter(|at| (2..7).contains(&(at % 9)) && (2..7).contains(&(at / 9))).collect();
        assert_eq!((found(0.49), found(0.5)), (near, vec![]));
    }

    #[test]
    fn the_cost_is_the_mean_of_the_lowest_two() {
        let size = Size::new(3, 3);
        let differences = [0.12, 0.04, 0.15, 0.06].map(|difference| vec![difference; 9]);
        assert!((cost(&differences, 4, size) - 0.05).abs() < 1e-6);
        assert!((cost(&differences[..1], 0, size) - 0.16).abs() < 1e-6, "another photo: the bound");
    }
}
