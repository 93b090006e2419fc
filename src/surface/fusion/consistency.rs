//! Which depths of a photo other photos confirm.
//!
//! A pixel of one map, carried to another photo, meets that photo's own depth (at the nearest pixel). It **agrees** where the two
//! differ by less than 2 px, and the other **sees past** it where its own depth lies more than 4 px behind (all in disparity of the
//! other; its map at the pixel that holds the point, floor of its coordinates; outside, it says nothing); px is the
//! first photo's pixel of parallax. A depth is confirmed where at least one other map agrees and no more see past than agree.

use ndarray::Array2;
use rayon::prelude::*;

use super::project::Projected;
use crate::geometry::{Camera, PlaneSweep};
use crate::surface::search::PhotoDepth;
use crate::surface::settings::Settings;
use crate::warp::whole;

/// A map agrees with another at a pixel; it sees past it there. Sums of up to 255 of them stay apart.
const AGREES: u16 = 1;
const SEES_PAST: u16 = 256;

/// What another photo's map says of each pixel of a photo's, `[h, w]`; the same however many others there are.
#[derive(Debug, Clone)]
pub struct ConsistencyVotes(Array2<u16>);

impl ConsistencyVotes {
    /// Of `other` on `map`.
    pub fn new(
        (camera, map): (&Camera, &PhotoDepth),
        (other_camera, other): (&Camera, &PhotoDepth),
        settings: &Settings,
    ) -> Self {
        let sweep = PlaneSweep::new(other_camera, camera);
        let margins = (settings.agree * map.pixel, -settings.past * map.pixel);
        let mut said = Array2::zeros(map.disparity.dim());
        let width = said.ncols();
        let rows = said.as_slice_mut().expect("standard order").par_chunks_mut(width).enumerate();
        rows.for_each_init(Projected::default, |projected, (y, said)| {
            projected.row(&sweep, y, map.disparity.row(y).to_slice().expect("standard order"));
            compare(projected, other, margins, said);
        });
        Self(said)
    }
}

#[pulp::with_simd(compare = crate::simd::arch())]
#[inline(always)]
fn compare_with<'a, S: pulp::Simd>(
    _simd: S,
    points: &'a Projected,
    other: &'a PhotoDepth,
    (agrees, past): (f32, f32),
    said: &'a mut [u16],
) {
    let (rows, columns) = other.disparity.dim();
    let cells = other.disparity.as_slice().expect("standard order");
    let (right, bottom) = (columns as f32, rows as f32);
    let points = points.x.iter().zip(&points.y).zip(&points.disparity);
    for (((&x, &y), &disparity), said) in points.zip(said) {
        if (x >= 0.0) & (y >= 0.0) & (x < right) & (y < bottom) {
            let at = |at: f32| whole(at.floor()) as usize;
            let nearer = cells[at(y) * columns + at(x)] - disparity;
            *said = AGREES * u16::from(nearer.abs() < agrees) + SEES_PAST * u16::from(nearer < past);
        }
    }
}

/// Pixels `[h, w]` of a photo's map that the opinions of other photos' maps confirm; none without any.
pub fn confirmed(opinions: &[&ConsistencyVotes], shape: (usize, usize)) -> Array2<bool> {
    let mut balance = Array2::<u16>::zeros(shape);
    opinions.iter().for_each(|ConsistencyVotes(said)| balance += said);
    balance.mapv(|balance| balance % SEES_PAST >= 1 && balance % SEES_PAST >= balance / SEES_PAST)
}
