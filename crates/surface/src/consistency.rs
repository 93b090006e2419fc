//! What photos confirm of each other's depth, and which points of a surface a photo sees.
//!
//! A pixel of one map, projected into another photo, is compared with that photo's own depth at the
//! pixel it falls on (floor of its coordinates; outside the photo there is no vote). The other map
//! **agrees** where the two disparities differ by less than 2 px, and **contradicts** where its own
//! depth lies more than 4 px behind: it sees past the point. Disparities are those of the other
//! photo; px is the first photo's disparity per pixel. A depth is confirmed where at least one map
//! agrees and no more contradict than agree.
//!
//! Projection of a pixel into another camera: for pixel p at disparity δ: (u, v, w) = H∞ p + δ e ([`PlaneSweep`]); its position is (u/w, v/w),
//! its disparity in the other camera δ/w, and it lies in front of that camera iff w > 0. In f64,
//! rounded once.

use glam::{DMat3, DVec3};
use ndarray::Array2;
use rayon::prelude::*;

use crate::PhotoDisparity;
use liveview::geometry::{Camera, PlaneSweep};
use liveview::warp::{RUN, round_to_i32};

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
    pub fn new((camera, map): (&Camera, &PhotoDisparity), (other_camera, other): (&Camera, &PhotoDisparity)) -> Self {
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
    other: &'a PhotoDisparity,
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
    own: (&Camera, &PhotoDisparity),
    others: impl Iterator<Item = (&'a Camera, &'a PhotoDisparity)>,
) -> ConfirmedDisparity {
    let votes: Vec<_> = others.map(|other| ConsistencyVotes::new(own, other)).collect();
    ConfirmedDisparity::new(own.1, &confirmed(&votes.iter().collect::<Vec<_>>(), own.1.disparity.dim()))
}

/// Disparities of a photo that other photos confirm.
#[derive(Debug, Clone)]
pub struct ConfirmedDisparity {
    /// 1/scene unit, `[h, w]`; −1 where it is not confirmed.
    pub disparity: Array2<f32>,
    /// Disparity that moves a point by one pixel ([`PhotoDisparity::disparity_per_pixel`]).
    pub disparity_per_pixel: f32,
}

impl ConfirmedDisparity {
    /// The confirmed pixels (`[h, w]`) of a depth map.
    pub fn new(depth: &PhotoDisparity, confirmed: &Array2<bool>) -> Self {
        let keep = |&disparity: &f32, &confirmed: &bool| if confirmed { disparity } else { -1.0 };
        let disparity = ndarray::Zip::from(&depth.disparity).and(confirmed).map_collect(keep);
        Self { disparity, disparity_per_pixel: depth.disparity_per_pixel }
    }

    /// Share of the pixels that are confirmed, 0 to 1.
    pub fn share(&self) -> f64 {
        let confirmed = self.disparity.iter().filter(|&&disparity| disparity >= 0.0).count();
        confirmed as f64 / self.disparity.len().max(1) as f64
    }
}

/// 1 where the view sees the point of each pixel of the target at `disparity` (row by row, `width`
/// wide), 0 where the view's own confirmed depth, at the pixel that the point projects to, is nearer
/// by `margin` (1/scene unit), −1 where it is farther by `margin`: the view sees past the point.
pub(crate) fn visible(
    (camera, depth): (&Camera, &ConfirmedDisparity),
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
    depth: &'a ConfirmedDisparity,
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

#[cfg(test)]
mod tests {
    use super::*;
    use liveview::geometry::Intrinsics;

    const WIDTH: usize = 72;
    const HEIGHT: usize = 10;

    fn camera(x: f64, z: f64, turn: f64) -> Camera {
        let intrinsics = Intrinsics { fx: 50.0, fy: 55.0, cx: 36.0, cy: 5.0, skew: 0.5 };
        Camera::new(intrinsics, WIDTH, HEIGHT, DMat3::from_rotation_y(turn), DVec3::new(x, 0.2 * x, z)).unwrap()
    }

    /// Depths about 0.2, in steps, some of them unknown.
    fn map(seed: u32, disparity_per_pixel: f32) -> PhotoDisparity {
        let value = |(y, x): (usize, usize)| match (7 * x as u32 + 31 * y as u32 + seed * (x as u32 / 3)) % 11 {
            0 => -1.0,
            step => 0.17 + 0.009 * step as f32,
        };
        PhotoDisparity { disparity: Array2::from_shape_fn((HEIGHT, WIDTH), value), disparity_per_pixel }
    }

    /// Where a pixel lies in the other camera, and its disparity there.
    fn exact(other: &Camera, here: &Camera, (x, y): (usize, usize), disparity: f32) -> DVec3 {
        let ray = here.k_inverse() * DVec3::new(x as f64 + 0.5, y as f64 + 0.5, 1.0);
        // X = ray / disparity in this camera; times the disparity, which may be 0.
        let pose = liveview::geometry::source_from_target(other, here);
        let point = pose.rotation * ray + pose.translation * f64::from(disparity);
        let pixel = other.k() * point / point.z;
        DVec3::new(pixel.x, pixel.y, if point.z > 0.0 { f64::from(disparity) / point.z } else { -1.0 })
    }

    #[test]
    fn projection_is_that_of_the_cameras() {
        let (here, other) = (camera(0.0, 0.0, 0.0), camera(0.3, -1.5, 0.1));
        let sweep = PlaneSweep::new(&other, &here);
        let disparity: Vec<f32> = (0..WIDTH).map(|x| 0.02 * x as f32).collect();
        let (mut row, mut behind) = (Projected::default(), 0);
        project_row(&sweep, 7, &disparity, &mut row);
        for (x, &disparity) in disparity.iter().enumerate() {
            let found = project(&sweep, (x, 7), disparity);
            assert_eq!(found, (row.x[x], row.y[x], row.disparity[x]));
            let expected = exact(&other, &here, (x, 7), disparity);
            if expected.z < 0.0 {
                assert_eq!(found, (-1.0, -1.0, 0.0));
                behind += 1;
            } else {
                let found = DVec3::new(found.0.into(), found.1.into(), found.2.into());
                assert!(
                    (found - expected).abs().max_element() < 1e-5 * expected.abs().max_element(),
                    "{found} {expected}"
                );
            }
        }
        assert!((10..60).contains(&behind), "{behind}");
    }

    #[test]
    fn a_map_agrees_within_two_pixels_and_contradicts_from_four_behind() {
        let here = camera(0.0, 0.0, 0.0);
        let flat = |disparity: f32| PhotoDisparity {
            disparity: Array2::from_elem((HEIGHT, WIDTH), disparity),
            disparity_per_pixel: 0.01,
        };
        for (pixels, vote) in [
            (0.0, AGREES),
            (1.99, AGREES),
            (-1.99, AGREES),
            (2.01, 0),
            (-2.01, 0),
            (9.0, 0),
            (-3.99, 0),
            (-4.01, CONTRADICTS),
            (-9.0, CONTRADICTS),
        ] {
            let votes = ConsistencyVotes::new((&here, &flat(0.2)), (&here, &flat(0.2 + 0.01 * pixels)));
            assert!(votes.0.iter().all(|&found| found == vote), "{pixels}: {:?}", votes.0[(0, 0)]);
        }
    }

    #[test]
    fn one_map_that_agrees_and_no_more_that_contradict_confirm() {
        let votes = |vote: u8| ConsistencyVotes(Array2::from_elem((1, 1), vote));
        for (agreeing, contradicting, expected) in [
            (0, 0, false),
            (0, 1, false),
            (1, 0, true),
            (1, 1, true),
            (1, 2, false),
            (2, 2, true),
            (3, 2, true),
            (2, 3, false),
        ] {
            let all: Vec<_> =
                (0..agreeing).map(|_| votes(AGREES)).chain((0..contradicting).map(|_| votes(CONTRADICTS))).collect();
            let found = confirmed(&all.iter().collect::<Vec<_>>(), (1, 1))[(0, 0)];
            assert_eq!(found, expected, "{agreeing} {contradicting}");
        }
    }

    #[test]
    fn votes_and_visibility_equal_their_definitions() {
        let (here, other) = (camera(0.0, 0.0, 0.0), camera(0.25, 0.2, 0.05));
        let (own, others) = (map(1, 0.004), map(5, 0.007));
        let votes = ConsistencyVotes::new((&here, &own), (&other, &others)).0;
        let depth = ConfirmedDisparity { disparity: others.disparity.clone(), disparity_per_pixel: 0.007 };
        let flat: Vec<f32> = own.disparity.iter().map(|d| d.abs()).collect();
        let seen = visible((&other, &depth), &here, &flat, WIDTH, 0.02);
        let sweep = PlaneSweep::new(&other, &here);
        let (mut met, mut met_seen) = ([0; 4], [0; 3]);
        for ((y, x), &vote) in votes.indexed_iter() {
            let at = |disparity: f32| {
                let (u, v, disparity) = project(&sweep, (x, y), disparity);
                let inside = (0.0..WIDTH as f32).contains(&u) && (0.0..HEIGHT as f32).contains(&v);
                inside.then(|| (others.disparity[(v as usize, u as usize)], disparity))
            };
            let expected = at(own.disparity[(y, x)]).map_or(0, |(other, disparity)| {
                u8::from((other - disparity).abs() < 0.008) + 2 * u8::from(disparity - other > 0.016)
            });
            assert_eq!(vote, expected, "row {y}, column {x}");
            met[usize::from(vote)] += 1;
            let expected = match at(flat[y * WIDTH + x]) {
                Some((other, disparity)) if other >= 0.0 && disparity - other >= 0.02 => -1.0,
                Some((other, disparity)) if other - disparity >= 0.02 => 0.0,
                _ => 1.0,
            };
            assert_eq!(seen[y * WIDTH + x], expected, "row {y}, column {x}");
            met_seen[(expected + 1.0) as usize] += 1;
        }
        assert!(met[..3].iter().chain(&met_seen).all(|&count| count > 20), "{met:?} {met_seen:?}");
    }

    #[test]
    fn a_point_at_the_margin_is_hidden_and_one_as_far_before_is_seen_past() {
        let here = camera(0.0, 0.0, 0.0);
        let depth =
            ConfirmedDisparity { disparity: Array2::from_elem((HEIGHT, WIDTH), 0.5), disparity_per_pixel: 0.01 };
        for (disparity, expected) in [(0.25, 0.0), (0.3, 1.0), (0.5, 1.0), (0.7, 1.0), (0.75, -1.0)] {
            let seen = visible((&here, &depth), &here, &[disparity; WIDTH], WIDTH, 0.25);
            assert!(seen.iter().all(|&seen| seen == expected), "{disparity}");
        }
    }

    #[test]
    fn the_confirmed_share_is_that_of_known_depths() {
        let depth = PhotoDisparity { disparity: ndarray::arr2(&[[0.0, 0.1, 0.2, 0.3]]), disparity_per_pixel: 0.01 };
        let confirmed = ConfirmedDisparity::new(&depth, &ndarray::arr2(&[[true, false, true, true]]));
        assert_eq!(confirmed.disparity, ndarray::arr2(&[[0.0, -1.0, 0.2, 0.3]]));
        assert_eq!((confirmed.share(), confirmed.disparity_per_pixel), (0.75, 0.01));
    }
}
