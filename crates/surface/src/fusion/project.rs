//! Projection of the pixels of one camera's depth map into another camera, with their disparity
//! there.
//!
//! For pixel p at disparity δ: (u, v, w) = H∞ p + δ e ([`PlaneSweep`]); its position is (u/w, v/w),
//! its disparity in the other camera δ/w, and it lies in front of that camera iff w > 0. In f64,
//! rounded once.

use glam::{DMat3, DVec3};

use liveview::geometry::PlaneSweep;

/// A row of pixels projected into another camera.
#[derive(Default)]
pub(crate) struct Projected {
    /// Column and row in pixels, the centre of the first at 0.5; −1 where the point lies behind the
    /// camera.
    pub(crate) x: Vec<f32>,
    pub(crate) y: Vec<f32>,
    /// 1/scene unit; 0 where the point lies behind the camera.
    pub(crate) disparity: Vec<f32>,
}

/// Projects row `y`, whose pixels have these disparities.
#[pulp::with_simd(project_row = liveview::simd::arch())]
#[inline(always)]
pub(crate) fn project_row_with<'a, S: pulp::Simd>(
    _simd: S,
    other_from_here: &'a PlaneSweep,
    y: usize,
    disparity: &'a [f32],
    projected: &'a mut Projected,
) {
    let PlaneSweep { homography_at_infinity: homography, epipole } = *other_from_here;
    let begin = row_begin(&homography, y);
    let count = disparity.len();
    let [to_x, to_y, to_disparity] = [&mut projected.x, &mut projected.y, &mut projected.disparity].map(|values| {
        values.resize(count, 0.0);
        &mut values[..count]
    });
    for i in 0..count {
        let x = f64::from(i as i32);
        (to_x[i], to_y[i], to_disparity[i]) = project_pixel(&homography, &epipole, begin, x, disparity[i]);
    }
}

/// Column, row and disparity of a pixel in another camera, as in [`Projected`].
pub(crate) fn project(other_from_here: &PlaneSweep, (x, y): (usize, usize), disparity: f32) -> (f32, f32, f32) {
    let PlaneSweep { homography_at_infinity: homography, epipole } = other_from_here;
    project_pixel(homography, epipole, row_begin(homography, y), x as f64, disparity)
}

/// H∞ at the centre of the first pixel of row `y`.
#[inline(always)]
fn row_begin(homography: &DMat3, y: usize) -> DVec3 {
    *homography * DVec3::new(0.5, y as f64 + 0.5, 1.0)
}

#[inline(always)]
fn project_pixel(homography: &DMat3, epipole: &DVec3, begin: DVec3, x: f64, disparity: f32) -> (f32, f32, f32) {
    let d = f64::from(disparity);
    let w = begin.z + homography.x_axis.z * x + epipole.z * d;
    let u = begin.x + homography.x_axis.x * x + epipole.x * d;
    let v = begin.y + homography.x_axis.y * x + epipole.y * d;
    let front = w > 0.0;
    let per_w = if front { 1.0 / w } else { 0.0 };
    let pixel = |value: f64| if front { (value * per_w) as f32 } else { -1.0 };
    (pixel(u), pixel(v), (d * per_w) as f32)
}
