//! Which points of the target's surface a view sees, by the view's own confirmed depth, and which it
//! sees past.

use rayon::prelude::*;

use super::confirmed_depth::ConfirmedDepth;
use super::project::{Projected, project_row};
use liveview::geometry::{Camera, PlaneSweep};
use liveview::warp::{RUN, round_to_i32};

/// 1 where the view sees the point of each pixel of the target at `disparity` (row by row, `width`
/// wide), 0 where the view's own confirmed depth, at the pixel that the point projects to, is nearer
/// by `margin` (1/scene unit), −1 where it is farther by `margin`: the view sees past the point.
pub(crate) fn visible(
    (camera, depth): (&Camera, &ConfirmedDepth),
    target: &Camera,
    disparity: &[f32],
    width: usize,
    margin: f32,
) -> Vec<f32> {
    let sweep = PlaneSweep::new(camera, target);
    let mut seen = vec![1.0; disparity.len()];
    let rows = seen.par_chunks_mut(width).zip(disparity.par_chunks(width)).enumerate();
    rows.for_each_init(Projected::default, |projected, (y, (seen, disparity))| {
        project_row(&sweep, y, disparity, projected);
        visible_row(projected, depth, margin, seen);
    });
    seen
}

#[pulp::with_simd(visible_row = liveview::simd::arch())]
#[inline(always)]
fn visible_row_with<'a, S: pulp::Simd>(
    _simd: S,
    points: &'a Projected,
    depth: &'a ConfirmedDepth,
    margin: f32,
    seen: &'a mut [f32],
) {
    let (rows, columns) = depth.disparity.dim();
    let own_disparity = depth.disparity.as_slice().expect("standard order");
    let (right, bottom) = (columns as f32, rows as f32);
    let runs = points.x.chunks(RUN).zip(points.y.chunks(RUN)).zip(points.disparity.chunks(RUN));
    // Indices, look-ups and comparisons apart: the first and the last vectorise.
    let (mut pixels, mut own) = ([OUTSIDE; RUN], [-1.0; RUN]);
    for (((x, y), disparity), seen) in runs.zip(seen.chunks_mut(RUN)) {
        for ((pixel, &x), &y) in pixels.iter_mut().zip(x).zip(y) {
            let inside = (x >= 0.0) & (y >= 0.0) & (x < right) & (y < bottom);
            let index = round_to_i32(y.floor()) * columns as i32 + round_to_i32(x.floor());
            *pixel = if inside { index as u32 } else { OUTSIDE };
        }
        for (own, &pixel) in own.iter_mut().zip(&pixels[..x.len()]) {
            *own = own_disparity.get(pixel as usize).copied().unwrap_or(-1.0);
        }
        for ((seen, &own), &disparity) in seen.iter_mut().zip(&own).zip(disparity) {
            let past = (own >= 0.0) & (disparity - own >= margin);
            *seen = match (past, own - disparity < margin) {
                (true, _) => -1.0,
                (false, true) => 1.0,
                (false, false) => 0.0,
            };
        }
    }
}

/// Index of the pixel of a point outside the photo.
const OUTSIDE: u32 = u32::MAX;
