//! Positions in the source of the samples of a run of target pixels: the texel above left, and the
//! weights of its right and lower neighbours.
//!
//! With H∞ and e of the [`PlaneSweep`], (u, v, w) = H∞ p + δ e and the position is (u, v)/w. A run
//! computes the position of its middle pixel in f64 and the offsets of the others in f32: offsets
//! are small, and f32 represents them three times more precisely than whole coordinates. Runs where
//! they are not small are computed in f64. Measured alternatives: docs/design-log/speed.md.

use std::ops::Range;

use glam::DVec3;

use super::run::{RUN, RunCoverage, clamp, clamp_from_zero, round_to_i32};
use super::{Texture, WarpSource};
use crate::geometry::PlaneSweep;

/// Index of the texel above left of each sample, in the source with its border, and the weights of
/// its right and lower neighbours. Samples outside the photo are clamped to the border, which is 0.
#[derive(Debug, Clone)]
pub struct SamplePositions {
    /// Index of the texel.
    pub texel: [u32; RUN],
    /// Weight of its right neighbour, 0 to 1.
    pub across: [f32; RUN],
    /// Weight of its lower neighbour, 0 to 1.
    pub down: [f32; RUN],
    /// Index of the photo's pixel that each falls on, `u32::MAX` outside (with `PIXELS` alone).
    pub(super) pixel: [u32; RUN],
    /// Its disparity in the view, 1/scene unit (with `PIXELS` alone).
    pub(super) disparity: [f32; RUN],
}

impl SamplePositions {
    /// Storage for a run.
    pub const NEW: Self =
        Self { texel: [0; RUN], across: [0.0; RUN], down: [0.0; RUN], pixel: [u32::MAX; RUN], disparity: [0.0; RUN] };

    /// Locates the pixels `run` of a row, at the given disparities (beyond the run's end: anything
    /// finite); with `PIXELS` also the photo's pixel that each falls on and its disparity there.
    /// Returns what is known about their coverage.
    #[inline(always)]
    pub fn locate<const PIXELS: bool>(
        &mut self,
        source: &WarpSource<'_>,
        row: usize,
        run: &Range<usize>,
        disparity: &[f32; RUN],
    ) -> RunCoverage {
        self.locate_by_offsets::<PIXELS>(source, row, run, disparity).unwrap_or_else(|| {
            self.locate_in_f64::<PIXELS>(source, row, run.start, disparity);
            RunCoverage::Partial
        })
    }

    /// All positions in f64, pixel by pixel.
    #[inline(always)]
    fn locate_in_f64<const PIXELS: bool>(
        &mut self,
        source: &WarpSource<'_>,
        row: usize,
        start: usize,
        disparity: &[f32; RUN],
    ) {
        let PlaneSweep { homography_at_infinity: homography, epipole } = source.sweep;
        let begin = homography * DVec3::new(0.5, row as f64 + 0.5, 1.0);
        let (right, bottom) = ((source.texture.width() + 1) as f64, (source.texture.height() + 1) as f64);
        for (i, &disparity) in disparity.iter().enumerate() {
            let uvw = begin + homography.x_axis * (start + i) as f64 + epipole * f64::from(disparity);
            // +0.5: pixel centres lie at halves, and the border adds one. NaN and w <= 0 give 0:
            // outside.
            let per_w = if uvw.z > 0.0 { 1.0 / uvw.z } else { f64::NAN };
            let (at_x, at_y) =
                (clamp_from_zero(uvw.x * per_w + 0.5, right), clamp_from_zero(uvw.y * per_w + 0.5, bottom));
            let (column, row) = (at_x as u32, at_y as u32);
            self.across[i] = (at_x - f64::from(column)) as f32;
            self.down[i] = (at_y - f64::from(row)) as f32;
            self.texel[i] = row * source.texture.stride() + column;
            if PIXELS {
                let at = (column as i32 - 1, row as i32 - 1);
                self.pixel[i] = nearest(at, (self.across[i], self.down[i]), source.texture);
                self.disparity[i] = if uvw.z > 0.0 { (f64::from(disparity) * per_w) as f32 } else { 0.0 };
            }
        }
    }

    /// The middle of the run in f64, the offsets of the others in f32; returns their coverage, or
    /// `None` where the offsets are not small.
    #[inline(always)]
    fn locate_by_offsets<const PIXELS: bool>(
        &mut self,
        source: &WarpSource<'_>,
        row: usize,
        run: &Range<usize>,
        disparity: &[f32; RUN],
    ) -> Option<RunCoverage> {
        let middle = RunMiddle::new(source, row, run, disparity)?;
        let RunMiddle { texel: (texel_x, texel_y), fraction: (fraction_x, fraction_y), per_column, .. } = middle;
        let stride = source.texture.stride() as i32;
        let (width, height) = (source.texture.width() as u32, source.texture.height() as u32);
        // The first and the last texel that samples are clamped to, relative to the middle's.
        let (left, top) = (-(texel_x as f32), -(texel_y as f32));
        let (right, bottom) = ((width + 1) as f32 + left, (height + 1) as f32 + top);
        let offset = |i: usize| middle.offset(i, disparity);
        // On a plane of a rectified rig all pixels have the same fractional part: a quarter less
        // time.
        let is_rectified = per_column[0] == 1.0 && per_column[1].abs().max(per_column[2].abs()) < RECTIFIED;
        if is_rectified && is_constant(disparity) {
            let first = texel_x - (run.len() / 2) as i32;
            if 1 <= first && first + RUN as i32 <= width as i32 && 1 <= texel_y && texel_y < height as i32 {
                (self.across, self.down) = ([fraction_x; RUN], [fraction_y; RUN]);
                self.texel = std::array::from_fn(|i| (texel_y * stride + first) as u32 + i as u32);
                if PIXELS {
                    for (i, &disparity) in disparity.iter().enumerate() {
                        let at = (first - 1 + i as i32, texel_y - 1);
                        self.pixel[i] = nearest(at, (fraction_x, fraction_y), source.texture);
                        self.disparity[i] = disparity * offset(i).3;
                    }
                }
                return Some(RunCoverage::All);
            }
        }
        // Minima and maxima of the bits, which have the order of the numbers from 0 on (NaN is
        // above all, negative numbers are below): unlike folds of floats, these vectorise.
        let (mut smallest_w, mut largest_offset, mut last_x, mut last_y) = (i32::MAX, 0, 0, 0);
        for (i, &disparity) in disparity.iter().enumerate() {
            let (w, dx, dy, per_w) = offset(i);
            smallest_w = smallest_w.min(w.to_bits() as i32);
            largest_offset = largest_offset.max(dx.abs().to_bits()).max(dy.abs().to_bits());
            let (dx, dy) = (clamp(fraction_x + dx, left, right), clamp(fraction_y + dy, top, bottom));
            let (floor_x, floor_y) = (dx.floor(), dy.floor());
            (self.across[i], self.down[i]) = (dx - floor_x, dy - floor_y);
            // Without the border; a sample that begins in the border is at -1, the largest u32.
            let (x, y) = (round_to_i32(floor_x) + texel_x - 1, round_to_i32(floor_y) + texel_y - 1);
            (last_x, last_y) = (last_x.max(x as u32), last_y.max(y as u32));
            self.texel[i] = ((y + 1) * stride + x + 1) as u32;
            if PIXELS {
                self.pixel[i] = nearest((x, y), (self.across[i], self.down[i]), source.texture);
                self.disparity[i] = disparity * per_w;
            }
        }
        if largest_offset >= MAX_OFFSET.to_bits() || smallest_w <= 0.5_f32.to_bits() as i32 {
            return None;
        }
        if last_x < width - 1 && last_y < height - 1 {
            return Some(RunCoverage::All);
        }
        let is_inside = |i: usize| {
            let (_, dx, dy, _) = offset(i);
            let (dx, dy) = (fraction_x + dx, fraction_y + dy);
            u32::from((dx > left) & (dx < right) & (dy > top) & (dy < bottom))
        };
        let any = (0..RUN).fold(0, |any, i| any | is_inside(i)) == 1;
        Some(if any { RunCoverage::Partial } else { RunCoverage::None })
    }
}

/// Runs with a larger offset from their middle, pixels, are computed in f64.
const MAX_OFFSET: f32 = 128.0;

/// Bound of the rounding errors of terms that are 0 on a rectified rig: they move a sample by less
/// than some ten-millionths of a pixel.
const RECTIFIED: f32 = 1e-10;

/// Index of the photo's pixel nearest to a position between pixel (x, y) and its right and lower
/// neighbours; `u32::MAX` outside.
#[inline(always)]
fn nearest((x, y): (i32, i32), (across, down): (f32, f32), photo: &Texture) -> u32 {
    let (width, height) = (photo.width() as u32, photo.height() as u32);
    let x = if across >= 0.5 { x + 1 } else { x } as u32;
    let y = if down >= 0.5 { y + 1 } else { y } as u32;
    if (x < width) & (y < height) { y.wrapping_mul(width).wrapping_add(x) } else { u32::MAX }
}

/// Whether the run lies on a plane that faces the target.
#[inline(always)]
fn is_constant(disparity: &[f32; RUN]) -> bool {
    disparity.iter().fold(0, |differs, d| differs | (d.to_bits() ^ disparity[0].to_bits())) == 0
}

/// Runs with coordinates beyond this, pixels, are computed in f64.
const MAX_COORDINATE: f64 = 1e6;

/// The middle of a run.
#[derive(Debug, Clone, Copy)]
pub(super) struct RunMiddle {
    /// Its index in the run.
    half: usize,
    /// Its column and row in the texture, in texels, the first of the border at 0: integer part.
    pub(super) texel: (i32, i32),
    /// Fractional part.
    pub(super) fraction: (f32, f32),
    /// At an offset of k columns and of d in disparity, (u, v)/w moves by
    /// (k per_column + d per_disparity) / (1 + k per_column.z + d per_disparity.z).
    pub(super) per_column: [f32; 3],
    per_disparity: [f32; 3],
    /// 1/w.
    per_w: f32,
}

impl RunMiddle {
    /// Of the pixels `run` of a row; `None` where it lies behind the source's camera, or too far
    /// outside.
    #[inline(always)]
    pub(super) fn new(source: &WarpSource<'_>, row: usize, run: &Range<usize>, disparity: &[f32; RUN]) -> Option<Self> {
        let half = run.len() / 2;
        let PlaneSweep { homography_at_infinity: homography, epipole } = source.sweep;
        let pixel = DVec3::new((run.start + half) as f64 + 0.5, row as f64 + 0.5, 1.0);
        let middle = homography * pixel + epipole * f64::from(disparity[half]);
        let (x, y) = (middle.x / middle.z, middle.y / middle.z);
        if !(middle.z > 0.0 && x.abs() < MAX_COORDINATE && y.abs() < MAX_COORDINATE) {
            return None;
        }
        let change =
            |uvw: DVec3| [uvw.x - x * uvw.z, uvw.y - y * uvw.z, uvw.z].map(|change| (change / middle.z) as f32);
        // +0.5: pixel centres lie at halves, and the border adds one.
        let (x, y) = (x + 0.5, y + 0.5);
        let (floor_x, floor_y) = (x.floor(), y.floor());
        Some(Self {
            half,
            texel: (floor_x as i32, floor_y as i32),
            fraction: ((x - floor_x) as f32, (y - floor_y) as f32),
            per_column: change(homography.x_axis),
            per_disparity: change(epipole),
            per_w: (1.0 / middle.z) as f32,
        })
    }

    /// Of pixel i of the run: w over that of the middle, the offset of (u, v)/w, and 1/w.
    #[inline(always)]
    pub(super) fn offset(&self, i: usize, disparity: &[f32; RUN]) -> (f32, f32, f32, f32) {
        let Self { half, per_column, per_disparity, .. } = self;
        let (k, d) = (i as i32 as f32 - *half as f32, disparity[i] - disparity[*half]);
        let w = 1.0 + (k * per_column[2] + d * per_disparity[2]);
        let per_w = 1.0 / w;
        let dx = (k * per_column[0] + d * per_disparity[0]) * per_w;
        let dy = (k * per_column[1] + d * per_disparity[1]) * per_w;
        (w, dx, dy, self.per_w * per_w)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::image::ImageRgb;

    /// Positions in the source of the pixels from 100 on of row 50: by offsets and in f64 (x and y
    /// of each), and the coverage of the former.
    fn locate_both_ways(
        homography: DMat3,
        epipole: DVec3,
        disparity: impl Fn(usize) -> f32,
    ) -> (Vec<[f64; 4]>, Option<RunCoverage>) {
        let photo = ImageRgb::new(320, 200, vec![0.5; 3 * 320 * 200]).unwrap();
        let texture = Texture::new(&photo);
        let source = WarpSource::new(&texture, PlaneSweep { homography_at_infinity: homography, epipole });
        let disparity = std::array::from_fn(disparity);
        let positions = |positions: &SamplePositions| {
            let stride = texture.stride();
            let position = |i: usize| {
                let [column, row] = [positions.texel[i] % stride, positions.texel[i] / stride];
                [f64::from(column) + f64::from(positions.across[i]), f64::from(row) + f64::from(positions.down[i])]
            };
            (0..RUN).map(position).collect::<Vec<_>>()
        };
        let (mut by_offsets, mut in_f64) = (SamplePositions::NEW, SamplePositions::NEW);
        in_f64.locate_in_f64::<true>(&source, 50, 100, &disparity);
        let coverage = by_offsets.locate_by_offsets::<true>(&source, 50, &(100..100 + RUN), &disparity);
        let pairs = positions(&by_offsets).into_iter().zip(positions(&in_f64)).map(|(a, b)| [a[0], a[1], b[0], b[1]]);
        (pairs.collect(), coverage)
    }

    #[test]
    fn locate_by_offsets_is_exact_to_some_millionths_of_a_pixel() {
        let tilted = DMat3::from_cols_array(&[1.02, 0.03, 2e-4, -0.02, 0.97, -1e-4, 9.3, -4.1, 1.0]);
        for (homography, step) in [(DMat3::IDENTITY, 0.0), (tilted, 0.0), (tilted, 1e-3)] {
            let (pairs, coverage) =
                locate_both_ways(homography, DVec3::new(210.3, 7.7, 0.01), |i| 0.1 + step * (i as f32).sin());
            assert!(coverage.is_some());
            for [x, y, exact_x, exact_y] in pairs {
                assert!((x - exact_x).abs() < 8e-6 && (y - exact_y).abs() < 8e-6, "{x} {y}, not {exact_x} {exact_y}");
            }
        }
    }

    /// Positions are those in the source with its border, whose first pixel centre is at 1.
    #[test]
    fn rectified_run_on_a_plane_has_one_fractional_part_up_to_the_edges() {
        let mut uniform = [0; 2];
        for (epipole, last, axis) in [(DVec3::X, 320.0, 0), (DVec3::Y, 200.0, 1)] {
            for step in -1500..1500 {
                let (pairs, coverage) = locate_both_ways(DMat3::IDENTITY, f64::from(step) * 1.37 * epipole, |_| 0.1);
                for [x, y, exact_x, exact_y] in &pairs {
                    assert!(
                        (x - exact_x).abs() < 8e-6 && (y - exact_y).abs() < 8e-6,
                        "{x} {y}, not {exact_x} {exact_y}"
                    );
                }
                let (first, end) = (pairs[0][2 + axis], pairs[RUN - 1][2 + axis]);
                let inside = first >= 1.0 && end < last;
                let touches = |at: f64, end: f64| (1e-5..end - 1e-5).contains(&at);
                let touched = pairs.iter().any(|&[.., x, y]| touches(x, 321.0) && touches(y, 201.0));
                assert!(!touched || coverage != Some(RunCoverage::None), "{first} to {end} are seen");
                assert_eq!(coverage == Some(RunCoverage::All), inside, "{first} to {end}");
                let part = |at: f64| at - at.floor();
                uniform[axis] += usize::from(inside && pairs.iter().all(|pair| part(pair[0]) == part(pairs[0][0])));
            }
        }
        assert!(uniform.iter().all(|&runs| runs > 100), "{uniform:?}");
        let (pairs, _) = locate_both_ways(DMat3::IDENTITY, DVec3::new(210.3, 7.7, 0.0), |i| 0.1 + 1e-3 * i as f32);
        assert!(pairs[1][0] - pairs[0][0] > 1.1, "a run that is not on a plane");
        let (pairs, _) =
            locate_both_ways(
                DMat3::IDENTITY,
                DVec3::new(210.3, 7.7, 0.0),
                |i| if i == 5 || i == 9 { 0.2 } else { 0.1 },
            );
        assert!(
            pairs[5][0] - pairs[4][0] > 20.0 && pairs[10][0] - pairs[9][0] < -10.0,
            "nor one with two points before it"
        );
    }

    #[test]
    fn large_offsets_and_the_horizon_are_computed_in_f64() {
        let stretched = DMat3::from_diagonal(DVec3::new(5.0, 1.0, 1.0));
        let horizon = DMat3::from_cols_array(&[1.0, 0.0, 0.01, 0.0, 1.0, 0.0, 0.0, 0.0, -1.4]);
        let behind = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, -1.0));
        for homography in [stretched, horizon, behind] {
            assert!(locate_both_ways(homography, DVec3::ZERO, |_| 0.0).1.is_none());
        }
        assert!(
            locate_both_ways(DMat3::IDENTITY, DVec3::new(300.0, 0.0, 0.0), |i| i as f32 / 64.0).1.is_none(),
            "steep disparity"
        );
    }

    /// In front of the view and behind it, inside its photo and beyond each side, in each of the three ways.
    #[test]
    fn pixels_and_disparities_are_those_of_the_points() {
        let texture = Texture::new(&ImageRgb::new(90, 60, vec![0.5; 3 * 90 * 60]).unwrap());
        let tilted = DMat3::from_cols_array(&[1.02, 0.03, 2e-4, -0.02, 0.97, -1e-4, 9.3, -4.1, 1.0]);
        let stretched = DMat3::from_cols_array(&[5.0, 0.4, 0.0, 0.0, 1.0, 0.0, -90.0, 0.0, 1.0]);
        let horizon = DMat3::from_cols_array(&[1.0, 0.0, 0.01, 0.0, 1.0, 0.0, 0.0, 0.0, -0.4]);
        let (mut met, mut outside) = ([0; 3], 0);
        for homography in [DMat3::IDENTITY, tilted, stretched, horizon] {
            for step in 0..400 {
                let epipole = DVec3::new(f64::from(step % 40) * 7.13 - 150.0, f64::from(step / 40) * 13.7 - 75.0, 0.02);
                let epipole = if step % 2 == 0 { epipole.with_z(0.0) } else { epipole };
                let source = WarpSource::new(&texture, PlaneSweep { homography_at_infinity: homography, epipole });
                let disparity: [f32; RUN] =
                    std::array::from_fn(|i| if step % 3 == 0 { 0.5 } else { 0.5 + 1e-3 * (i as f32).sin() });
                let mut found = SamplePositions::NEW;
                let by_offsets = found.locate_by_offsets::<true>(&source, 31, &(12..12 + RUN), &disparity);
                if by_offsets.is_none() {
                    found.locate_in_f64::<true>(&source, 31, 12, &disparity);
                }
                met[match by_offsets {
                    None => 0,
                    Some(RunCoverage::All) => 1,
                    Some(_) => 2,
                }] += 1;
                for (i, &own) in disparity.iter().enumerate() {
                    let at = DVec3::new(12.5 + i as f64, 31.5, 1.0);
                    let uvw = homography * at + epipole * f64::from(own);
                    let (u, v) = (uvw.x / uvw.z, uvw.y / uvw.z);
                    if uvw.z.abs() < 1e-3 || (u - u.round()).abs() < 1e-3 || (v - v.round()).abs() < 1e-3 {
                        continue; // rounding decides
                    }
                    let inside = uvw.z > 0.0 && (0.0..90.0).contains(&u) && (0.0..60.0).contains(&v);
                    let expected = if inside { v as u32 * 90 + u as u32 } else { u32::MAX };
                    assert_eq!(found.pixel[i], expected, "{homography} {epipole}: {i} at ({u}, {v})");
                    outside += usize::from(!inside);
                    let expected = if uvw.z > 0.0 { f64::from(own) / uvw.z } else { 0.0 };
                    assert!(
                        (f64::from(found.disparity[i]) - expected).abs() < 1e-5 * (1.0 + expected),
                        "{homography}: {i}"
                    );
                }
            }
        }
        assert!(met.iter().all(|&runs| runs > 50) && outside > 10_000, "{met:?} {outside}");
    }
}
