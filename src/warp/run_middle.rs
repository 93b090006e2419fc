//! Where the middle pixel of a run lies in the source, in f64, and how far from it the others lie, in f32.

use std::ops::Range;

use glam::DVec3;

use super::sample_positions::RUN;
use super::source::WarpSource;
use super::texture::Texture;
use crate::geometry::PlaneSweep;

/// Runs with coordinates beyond this, in pixels, are computed in f64.
const FAR_OUT: f64 = 1e6;

/// The middle of a run.
#[derive(Debug, Clone, Copy)]
pub(super) struct RunMiddle {
    /// Its index in the run.
    half: usize,
    /// Where it lies in the texture, in texels, the first of the border at 0: whole columns and rows, and what remains.
    pub(super) whole: (i32, i32),
    pub(super) part: (f32, f32),
    /// k columns and d in disparity away, (u, v)/w moves by (k column + d deeper) / (1 + k column.z + d deeper.z).
    pub(super) column: [f32; 3],
    deeper: [f32; 3],
    /// 1/w.
    per_w: f32,
}

impl RunMiddle {
    /// Of the pixels `run` of a row; `None` where it lies behind the source's camera, or far out.
    #[inline(always)]
    pub(super) fn new(source: &WarpSource<'_>, row: usize, run: &Range<usize>, disparity: &[f32; RUN]) -> Option<Self> {
        let half = run.len() / 2;
        let PlaneSweep { homography_at_infinity: homography, epipole } = source.sweep;
        let pixel = DVec3::new((run.start + half) as f64 + 0.5, row as f64 + 0.5, 1.0);
        let middle = homography * pixel + epipole * f64::from(disparity[half]);
        let (x, y) = (middle.x / middle.z, middle.y / middle.z);
        if !(middle.z > 0.0 && x.abs() < FAR_OUT && y.abs() < FAR_OUT) {
            return None;
        }
        let change =
            |uvw: DVec3| [uvw.x - x * uvw.z, uvw.y - y * uvw.z, uvw.z].map(|change| (change / middle.z) as f32);
        // +0.5: pixel centres lie at halves, the border adds one.
        let (x, y) = (x + 0.5, y + 0.5);
        let (whole_x, whole_y) = (x.floor(), y.floor());
        Some(Self {
            half,
            whole: (whole_x as i32, whole_y as i32),
            part: ((x - whole_x) as f32, (y - whole_y) as f32),
            column: change(homography.x_axis),
            deeper: change(epipole),
            per_w: (1.0 / middle.z) as f32,
        })
    }

    /// w of pixel i of the run over that of the middle, by how much (u, v)/w moves, and 1/w.
    #[inline(always)]
    pub(super) fn moved(&self, i: usize, disparity: &[f32; RUN]) -> (f32, f32, f32, f32) {
        let Self { half, column, deeper, .. } = self;
        let (k, d) = (i as i32 as f32 - *half as f32, disparity[i] - disparity[*half]);
        let w = 1.0 + (k * column[2] + d * deeper[2]);
        let per_w = 1.0 / w;
        let (dx, dy) = ((k * column[0] + d * deeper[0]) * per_w, (k * column[1] + d * deeper[1]) * per_w);
        (w, dx, dy, self.per_w * per_w)
    }

    /// The first and the last texel that samples are clamped to, as distances from the middle's whole columns and rows.
    #[inline(always)]
    pub(super) fn bounds(&self, texture: &Texture) -> ((f32, f32), (f32, f32)) {
        let (x, y) = (self.whole.0 as f32, self.whole.1 as f32);
        ((-x, -y), ((texture.width() + 1) as f32 - x, (texture.height() + 1) as f32 - y))
    }
}
