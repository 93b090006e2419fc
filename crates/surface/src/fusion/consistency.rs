//! Which depths of a photo other photos confirm.
//!
//! A pixel of one map, projected into another photo, is compared with that photo's own depth at the
//! pixel it falls on (floor of its coordinates; outside the photo there is no vote). The other map
//! **agrees** where the two disparities differ by less than 2 px, and **contradicts** where its own
//! depth lies more than 4 px behind: it sees past the point. Disparities are those of the other
//! photo; px is the first photo's disparity per pixel. A depth is confirmed where at least one map
//! agrees and no more contradict than agree.

use ndarray::Array2;
use rayon::prelude::*;

use super::confirmed_depth::ConfirmedDepth;
use super::project::{Projected, project_row};
use crate::search::PhotoDepth;
use liveview::geometry::{Camera, PlaneSweep};
use liveview::warp::round_to_i32;

/// Another map agrees with a depth within this, px.
const AGREEMENT_PX: f32 = 2.0;
/// Another map contradicts a depth from this far behind it on, px.
const CONTRADICTION_PX: f32 = 4.0;

/// A vote for a depth and one against it.
const AGREES: u8 = 1;
const CONTRADICTS: u8 = 2;
/// A vote against a depth in a total: up to 255 of each kind stay apart.
const TOTAL_AGAINST: u16 = 256;

/// Votes of another photo's map on each pixel of a photo's map, `[h, w]`; independent of which
/// other maps take part.
#[derive(Debug, Clone)]
pub struct ConsistencyVotes(Array2<u8>);

impl ConsistencyVotes {
    /// The votes of the map `other` on `map`.
    pub fn new((camera, map): (&Camera, &PhotoDepth), (other_camera, other): (&Camera, &PhotoDepth)) -> Self {
        let sweep = PlaneSweep::new(other_camera, camera);
        let px = map.disparity_per_pixel;
        let margins = (AGREEMENT_PX * px, -CONTRADICTION_PX * px);
        let mut votes = Array2::zeros(map.disparity.dim());
        let width = votes.ncols();
        let rows = votes.as_slice_mut().expect("standard order").par_chunks_mut(width).enumerate();
        rows.for_each_init(Projected::default, |projected, (y, votes)| {
            project_row(&sweep, y, map.disparity.row(y).to_slice().expect("standard order"), projected);
            vote_row(projected, other, margins, votes);
        });
        Self(votes)
    }

    pub(crate) fn bytes(&self) -> usize {
        self.0.len()
    }
}

#[pulp::with_simd(vote_row = liveview::simd::arch())]
#[inline(always)]
fn vote_row_with<'a, S: pulp::Simd>(
    _simd: S,
    points: &'a Projected,
    other: &'a PhotoDepth,
    (agreement, contradiction): (f32, f32),
    votes: &'a mut [u8],
) {
    let (rows, columns) = other.disparity.dim();
    let other_disparity = other.disparity.as_slice().expect("standard order");
    let (right, bottom) = (columns as f32, rows as f32);
    let points = points.x.iter().zip(&points.y).zip(&points.disparity);
    for (((&x, &y), &disparity), vote) in points.zip(votes) {
        if (x >= 0.0) & (y >= 0.0) & (x < right) & (y < bottom) {
            let pixel = |at: f32| round_to_i32(at.floor()) as usize;
            let nearer = other_disparity[pixel(y) * columns + pixel(x)] - disparity;
            *vote = AGREES * u8::from(nearer.abs() < agreement) + CONTRADICTS * u8::from(nearer < contradiction);
        }
    }
}

/// Pixels `[h, w]` of a photo's map that the votes of other photos' maps confirm; none without
/// votes.
pub fn confirmed(votes: &[&ConsistencyVotes], shape: (usize, usize)) -> Array2<bool> {
    let mut totals = Array2::<u16>::zeros(shape);
    for ConsistencyVotes(votes) in votes {
        totals.zip_mut_with(votes, |total, &vote| {
            *total += u16::from(vote & AGREES) + TOTAL_AGAINST * u16::from(vote / CONTRADICTS);
        });
    }
    totals.mapv(|total| total % TOTAL_AGAINST >= 1 && total % TOTAL_AGAINST >= total / TOTAL_AGAINST)
}

/// What other maps confirm of a map.
pub(crate) fn confirmed_by<'a>(
    own: (&Camera, &PhotoDepth),
    others: impl Iterator<Item = (&'a Camera, &'a PhotoDepth)>,
) -> ConfirmedDepth {
    let votes: Vec<_> = others.map(|other| ConsistencyVotes::new(own, other)).collect();
    ConfirmedDepth::new(own.1, &confirmed(&votes.iter().collect::<Vec<_>>(), own.1.disparity.dim()))
}
