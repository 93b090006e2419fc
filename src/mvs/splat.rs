//! Depths of photos carried to the target: each pixel as a square of half a pixel's side, nearest wins.
//!
//! A point lies in the pixels that hold its four corners (±0.25 pixel); of each photo's points each pixel keeps the largest
//! disparity. Over the photos: the mean, in f32 and in their order, of those at most `fuse` behind the largest of all.

use rayon::prelude::*;

use super::project::Projected;
use super::{Camera, KnownDepth, PlaneSweep, Size, whole};

/// Half a side of a point, in pixels.
const HALF: f32 = 0.25;

/// Disparity of each pixel of a padded target of `size`, row by row; −1 where nothing falls.
pub(super) fn splat(maps: &[(&Camera, &KnownDepth)], target: &Camera, size: Size, fuse: f32) -> Vec<f32> {
    let each: Vec<Vec<f32>> = maps.par_iter().map(|map| splat_one(map, target, size)).collect();
    let mut fused = vec![-1.0; size.pixels()];
    fused.par_chunks_mut(size.width).enumerate().for_each(|(y, fused)| {
        let rows: Vec<&[f32]> = each.iter().map(|map| &map[y * size.width..(y + 1) * size.width]).collect();
        fuse_row(&rows, fuse, fused);
    });
    fused
}

#[pulp::with_simd(fuse_row = pulp::Arch::new())]
#[inline(always)]
fn fuse_row_with<'a, S: pulp::Simd>(_simd: S, rows: &'a [&'a [f32]], fuse: f32, fused: &'a mut [f32]) {
    let width = fused.len();
    for row in rows {
        let row = &row[..width];
        for x in 0..width {
            fused[x] = if row[x] > fused[x] { row[x] } else { fused[x] };
        }
    }
    let (mut sum, mut number) = (vec![0.0_f32; width], vec![0.0_f32; width]);
    for row in rows {
        let row = &row[..width];
        for x in 0..width {
            let counts = (row[x] >= 0.0) & (fused[x] - row[x] <= fuse);
            sum[x] += if counts { row[x] } else { 0.0 };
            number[x] += if counts { 1.0 } else { 0.0 };
        }
    }
    for x in 0..width {
        fused[x] = if number[x] > 0.0 { sum[x] / number[x] } else { fused[x] };
    }
}

fn splat_one((camera, map): &(&Camera, &KnownDepth), target: &Camera, size: Size) -> Vec<f32> {
    let mut buffer = vec![-1.0_f32; size.pixels()];
    let (sweep, mut projected) = (PlaneSweep::new(target, camera), Projected::default());
    let (right, bottom) = (size.width as f32, size.height as f32);
    for (y, row) in map.disparity.outer_iter().enumerate() {
        let row = row.to_slice().expect("standard order");
        projected.row(&sweep, y, row);
        let points = projected.x.iter().zip(&projected.y).zip(&projected.disparity).zip(row);
        for (((&x, &y), &disparity), &own) in points {
            // Behind the camera: at −1.
            if own < 0.0 || !(x >= -HALF && y >= -HALF && x < right + HALF && y < bottom + HALF) {
                continue;
            }
            let corner = |at: f32| whole(at.floor());
            let (left, top) = (corner(x - HALF).max(0) as usize, corner(y - HALF).max(0) as usize);
            let last_x = (corner(x + HALF).max(0) as usize).min(size.width - 1);
            let last_y = (corner(y + HALF).max(0) as usize).min(size.height - 1);
            for row in top..=last_y {
                for held in &mut buffer[row * size.width + left.min(last_x)..=row * size.width + last_x] {
                    *held = if disparity > *held { disparity } else { *held };
                }
            }
        }
    }
    buffer
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use ndarray::Array2;

    use super::*;
    use crate::geometry::Intrinsics;

    fn camera(shift: f64) -> Camera {
        let intrinsics = Intrinsics { fx: 8.0, fy: 8.0, cx: 4.0, cy: 4.0, skew: 0.0 };
        Camera::new(intrinsics, 8, 8, DMat3::IDENTITY, DVec3::new(-shift, 0.0, 0.0)).unwrap()
    }

    #[test]
    fn points_move_by_their_parallax_and_the_nearest_wins() {
        // Disparity 1 moves by eight pixels for a unit's shift.
        let mut map = KnownDepth { disparity: Array2::from_elem((8, 8), -1.0) };
        map.disparity[(3, 5)] = 1.0;
        map.disparity[(3, 3)] = 0.0;
        let found = splat(&[(&camera(0.0), &map)], &camera(0.25), Size::new(8, 8), 0.0);
        let expected = |at: usize| if at == 3 * 8 + 3 { 1.0 } else { -1.0 };
        assert!(found.iter().enumerate().all(|(at, &d)| d == expected(at)), "{found:?}");
    }

    #[test]
    fn photos_that_almost_agree_are_averaged() {
        let at = |d: f32| KnownDepth { disparity: Array2::from_elem((8, 8), d) };
        let (a, b, c) = (at(0.5), at(0.45), at(0.1));
        let here = camera(0.0);
        let maps = [(&here, &a), (&here, &b), (&here, &c)];
        assert!(splat(&maps, &here, Size::new(8, 8), 0.1).iter().all(|&d| d == (0.5 + 0.45) / 2.0));
        assert!(splat(&maps, &here, Size::new(8, 8), 0.0).iter().all(|&d| d == 0.5));
    }
}
