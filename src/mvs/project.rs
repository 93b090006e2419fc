//! Where the pixels of one camera's map lie in another camera, and their disparity there.
//!
//! For pixel p at disparity δ: (u, v, w) = H∞ p + δ e ([`PlaneSweep`]); it lies at (u/w, v/w), at disparity δ/w of the other
//! camera, in front of it iff w > 0. In f64, rounded once.

use glam::DVec3;

use super::PlaneSweep;

/// A row of pixels in another camera.
#[derive(Default)]
pub(super) struct Projected {
    /// Column and row in pixels, the centre of the first at 0.5; −1 where the point lies behind the camera.
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    /// 1/scene unit; 0 where the point lies behind the camera.
    pub(super) disparity: Vec<f32>,
}

impl Projected {
    /// Row `y`, whose pixels lie at `disparity`.
    pub(super) fn row(&mut self, other_from_here: &PlaneSweep, y: usize, disparity: &[f32]) {
        self.part(other_from_here, (0, y), disparity);
    }

    /// Part of a row, from column `x` of row `y` on, whose pixels lie at `disparity`.
    pub(super) fn part(&mut self, other_from_here: &PlaneSweep, (x, y): (usize, usize), disparity: &[f32]) {
        for values in [&mut self.x, &mut self.y, &mut self.disparity] {
            values.resize(disparity.len(), 0.0);
        }
        project_row(other_from_here, (x, y), disparity, [&mut self.x, &mut self.y, &mut self.disparity]);
    }
}

#[pulp::with_simd(project_row = pulp::Arch::new())]
#[inline(always)]
fn project_row_with<'a, S: pulp::Simd>(
    _simd: S,
    sweep: &'a PlaneSweep,
    (column, row): (usize, usize),
    disparity: &'a [f32],
    [to_x, to_y, to_disparity]: [&'a mut Vec<f32>; 3],
) {
    let PlaneSweep { homography_at_infinity: homography, epipole } = *sweep;
    let begin = homography * DVec3::new(0.5, row as f64 + 0.5, 1.0);
    let count = disparity.len();
    let (to_x, to_y, to_disparity) = (&mut to_x[..count], &mut to_y[..count], &mut to_disparity[..count]);
    for i in 0..count {
        let (x, d) = (f64::from((column + i) as i32), f64::from(disparity[i]));
        let w = begin.z + homography.x_axis.z * x + epipole.z * d;
        let u = begin.x + homography.x_axis.x * x + epipole.x * d;
        let v = begin.y + homography.x_axis.y * x + epipole.y * d;
        let front = w > 0.0;
        let per_w = if front { 1.0 / w } else { 0.0 };
        to_x[i] = if front { (u * per_w) as f32 } else { -1.0 };
        to_y[i] = if front { (v * per_w) as f32 } else { -1.0 };
        to_disparity[i] = (d * per_w) as f32;
    }
}
