//! Which depths of a photo other photos confirm.
//!
//! A pixel of one map, carried to another photo, meets that photo's own depth (at the nearest pixel). It **agrees** where the two
//! differ by less than 2 px, and the other **sees past** it where its own depth lies more than 4 px behind (all in disparity of the
//! other; its map at the pixel that holds the point, floor of its coordinates; outside, it says nothing); px is the
//! first photo's pixel of parallax. A depth is confirmed where at least one other map agrees and no more see past than agree.

use ndarray::Array2;
use rayon::prelude::*;

use super::project::Projected;
use super::{Camera, PhotoDepth, PlaneSweep, Settings};

/// Confirmed pixels of map `which` among `maps`, `[h, w]`.
pub fn confirmed(which: usize, maps: &[(&Camera, &PhotoDepth)], settings: &Settings) -> Array2<bool> {
    let (camera, map) = maps[which];
    let (height, width) = map.disparity.dim();
    let others: Vec<_> = maps.iter().enumerate().filter(|(other, _)| *other != which).map(|(_, other)| other).collect();
    let sweeps: Vec<_> = others.iter().map(|(other, _)| PlaneSweep::new(other, camera)).collect();
    let (agrees, past) = (settings.agree * map.pixel, -settings.past * map.pixel);
    let mut confirmed = Array2::from_elem((height, width), false);
    let rows = confirmed.as_slice_mut().expect("standard order").par_chunks_mut(width).enumerate();
    rows.for_each_init(
        || (Projected::default(), vec![0_i32; width], vec![0_i32; width]),
        |(projected, agree, seen_past), (y, out)| {
            agree.fill(0);
            seen_past.fill(0);
            let row = map.disparity.row(y);
            let row = row.to_slice().expect("standard order");
            for ((_, other), sweep) in others.iter().zip(&sweeps) {
                projected.row(sweep, y, row);
                let (rows, columns) = other.disparity.dim();
                let cells = other.disparity.as_slice().expect("standard order");
                for x in 0..width {
                    let (at_x, at_y) = (projected.x[x], projected.y[x]);
                    if at_x >= 0.0 && at_y >= 0.0 && at_x < columns as f32 && at_y < rows as f32 {
                        let own = cells[at_y as usize * columns + at_x as usize];
                        let nearer = own - projected.disparity[x];
                        agree[x] += i32::from(nearer.abs() < agrees);
                        seen_past[x] += i32::from(nearer < past);
                    }
                }
            }
            for (x, out) in out.iter_mut().enumerate() {
                *out = agree[x] as f32 >= settings.votes.min(others.len() as f32).max(1.0) && agree[x] >= seen_past[x];
            }
        },
    );
    confirmed
}
