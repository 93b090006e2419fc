//! Which points of the target's surface a view sees, by the view's own depth.

use rayon::prelude::*;

use super::confirmed_depth::ConfirmedDepth;
use super::project::Projected;
use crate::geometry::{Camera, PlaneSweep};
use crate::warp::whole;

/// 1 where the view sees the points of a row, else 0.
#[pulp::with_simd(see = crate::simd::arch())]
#[inline(always)]
fn see_with<'a, S: pulp::Simd>(
    _simd: S,
    points: &'a Projected,
    map: &'a ConfirmedDepth,
    margin: f32,
    seen: &'a mut [f32],
) {
    let (rows, columns) = map.disparity.dim();
    let cells = map.disparity.as_slice().expect("standard order");
    let (right, bottom) = (columns as f32, rows as f32);
    let points = points.x.iter().zip(&points.y).zip(&points.disparity);
    for (((&x, &y), &disparity), seen) in points.zip(seen) {
        let inside = (x >= 0.0) & (y >= 0.0) & (x < right) & (y < bottom);
        let at = |at: f32| whole(at.floor()) as usize;
        let own = if inside { cells[at(y) * columns + at(x)] } else { -1.0 };
        *seen = if own - disparity < margin { 1.0 } else { 0.0 };
    }
}

/// 1 where the view sees the point of each pixel of the target at `disparity` (row by row, `width` wide), else 0.
pub(crate) fn visible(
    (camera, map): (&Camera, &ConfirmedDepth),
    target: &Camera,
    disparity: &[f32],
    width: usize,
    margin: f32,
) -> Vec<f32> {
    let sweep = PlaneSweep::new(camera, target);
    let mut seen = vec![1.0; disparity.len()];
    let lines = seen.par_chunks_mut(width).zip(disparity.par_chunks(width)).enumerate();
    lines.for_each_init(Projected::default, |projected, (y, (seen, disparity))| {
        projected.row(&sweep, y, disparity);
        see(projected, map, margin, seen);
    });
    seen
}
