//! Distances and angles between cameras, without comparing every pair.

use glam::DVec3;

/// A direction on which few cameras of a regular grid have the same projection.
const OBLIQUE: DVec3 = DVec3::new(0.781, 0.532, 0.327);
/// Tolerance of angles, in radians.
const ANGLE_TOLERANCE: f64 = 1e-6;

/// Distance from each point to its nearest neighbour, in no particular order; empty for a single
/// point.
pub(super) fn nearest_distances(points: &[DVec3]) -> Vec<f64> {
    let along = OBLIQUE.normalize();
    let mut sorted: Vec<(f64, DVec3)> = points.iter().map(|point| (point.dot(along), *point)).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let nearest = |index: usize| {
        let (at, point) = sorted[index];
        let mut best = f64::INFINITY;
        // The distance of two points is at least that of their projections.
        let mut compare = |other: &(f64, DVec3)| {
            let may_be_nearer = (other.0 - at).abs() < best;
            best = best.min(other.1.distance(point));
            may_be_nearer
        };
        let _ = sorted[index + 1..].iter().all(&mut compare);
        let _ = sorted[..index].iter().rev().all(&mut compare);
        best
    };
    (0..sorted.len()).map(nearest).filter(|distance| distance.is_finite()).collect()
}

/// Largest angle between two of these unit vectors, in radians, accurate to [`ANGLE_TOLERANCE`]; 0
/// for a single one.
pub(super) fn largest_angle(directions: &[DVec3]) -> f64 {
    let mean = directions.iter().sum::<DVec3>().normalize_or(DVec3::Z);
    let mut from_mean: Vec<(f64, DVec3)> = directions.iter().map(|d| (mean.angle_between(*d), *d)).collect();
    from_mean.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut largest = 0.0_f64;
    for (index, (angle, direction)) in from_mean.iter().enumerate() {
        // The angle of two directions is at most the sum of their angles to the mean.
        let candidates = from_mean[..index].iter().take_while(|other| other.0 + angle > largest + ANGLE_TOLERANCE);
        let min_cosine = candidates.map(|(_, other)| other.dot(*direction)).fold(f64::INFINITY, f64::min);
        if min_cosine < largest.cos() {
            largest = min_cosine.clamp(-1.0, 1.0).acos();
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Random points in a cube, from a linear congruential generator.
    fn cube(count: usize) -> Vec<DVec3> {
        let mut state = 7_u64;
        let mut next = || {
            state = state * 48_271 % 0x7FFF_FFFF;
            state as f64 / f64::from(0x7FFF_FFFF)
        };
        (0..count).map(|_| DVec3::new(next(), next(), next())).collect()
    }

    #[test]
    fn distances_and_angles_equal_those_of_all_pairs() {
        let points = cube(300);
        let others = |i: usize| (0..points.len()).filter(move |&j| j != i);
        let mut expected: Vec<f64> =
            (0..300).map(|i| others(i).map(|j| points[i].distance(points[j])).fold(f64::INFINITY, f64::min)).collect();
        let mut found = nearest_distances(&points);
        expected.sort_by(f64::total_cmp);
        found.sort_by(f64::total_cmp);
        assert_eq!(found, expected);
        for (centre, spread) in [(DVec3::ZERO, 1.0), (DVec3::splat(-0.5), 1.0), (DVec3::new(0.0, 0.0, 9.0), 1.0)] {
            let directions: Vec<DVec3> = points.iter().map(|p| (*p * spread + centre).normalize()).collect();
            let pairs = (0..300).flat_map(|i| others(i).map(move |j| (i, j)));
            let expected = pairs.map(|(i, j)| directions[i].angle_between(directions[j])).fold(0.0, f64::max);
            assert!((largest_angle(&directions) - expected).abs() < 2e-6);
        }
        assert_eq!((nearest_distances(&points[..1]), largest_angle(&[DVec3::X])), (vec![], 0.0));
        assert!(largest_angle(&[DVec3::X, DVec3::X, -DVec3::X]) > 3.1);
    }

    /// All pairs would be ten thousand million distances.
    #[test]
    fn a_hundred_thousand_cameras_take_little_time() {
        let points = cube(100_000);
        assert_eq!(nearest_distances(&points).len(), points.len());
        let column = |k: usize| DVec3::new(if k.is_multiple_of(2) { 0.0 } else { 1e3 }, (k / 2) as f64, 0.0);
        let columns: Vec<DVec3> = (0..100_000).map(column).collect();
        assert!(nearest_distances(&columns).iter().all(|&distance| distance == 1.0));
        assert_eq!(largest_angle(&vec![DVec3::Z; 100_000]), 0.0);
        let ahead: Vec<DVec3> = points.iter().map(|p| (*p - DVec3::splat(0.5) + DVec3::Z * 4.0).normalize()).collect();
        assert!(largest_angle(&ahead) > 0.1);
    }
}
