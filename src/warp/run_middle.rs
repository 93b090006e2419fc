//! Position in the source of the middle pixel of a run, in f64, and the offsets of the others from
//! it, in f32.

use std::ops::Range;

use glam::DVec3;

use super::run::RUN;
use super::source::WarpSource;
use super::texture::Texture;
use crate::geometry::PlaneSweep;

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

    /// The first and the last texel that samples are clamped to, relative to [`Self::texel`].
    #[inline(always)]
    pub(super) fn bounds(&self, texture: &Texture) -> ((f32, f32), (f32, f32)) {
        let (x, y) = (self.texel.0 as f32, self.texel.1 as f32);
        ((-x, -y), ((texture.width() + 1) as f32 - x, (texture.height() + 1) as f32 - y))
    }
}
