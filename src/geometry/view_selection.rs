//! The choice of the views that a target is rendered from.

use glam::DVec3;

use super::camera::Camera;

/// Cosine of the largest angle (60 degrees) between the optical axes of a target and its views.
const MIN_COSINE: f64 = 0.5;
/// Cameras to choose among.
const POOL: usize = 10;
/// Points a side of the grid of a target's pixels, and their depths.
const GRID: usize = 12;
const DEPTHS: [f64; 3] = [0.6, 1.0, 2.0];
/// What it is worth to see a point, by how many chosen cameras see it already.
const WORTH: [f64; 5] = [1.0, 0.5, 0.25, 0.12, 0.06];
/// Cost of a direction that a chosen camera has already.
const ALIKE: f64 = 0.3;
/// Costs that differ by less, relatively, are equal: the nearest is taken.
const ROUNDING: f64 = 1e-9;
/// Factor of the cost of a camera that is kept.
const KEPT: f64 = 0.9;

/// Too few views face the target's direction: with optical axes within 60 degrees of the target's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "{wanted} views are needed, but only {found} of {of} {}; expected more photos, or fewer views (--views)",
    if found < of { "face the target's direction (optical axes within 60 degrees)" } else { "can be used" }
)]
pub struct TooFewViews {
    /// Number of views needed: V of the model.
    pub wanted: usize,
    /// Number of views that qualify.
    pub found: usize,
    /// Number of views.
    pub of: usize,
}

/// Indices of the `count` cameras to render the target from, nearest first: those that show it, from all
/// sides. They are chosen one after another among the ten nearest with optical axes within 60 degrees of
/// the target's; each time the camera with the lowest
///
/// distance · (1 + 0.3 · c) / √(g + 0.001)
///
/// where c is the largest cosine, at least 0, between its direction from the target and those of the chosen
/// ones, and g the mean over 12×12 pixels of the target at three depths of 1, ½, ¼, 0.12 or 0.06, by how
/// many of the chosen ones see that point already, or of 0 if it does not see it. The depths are 0.6, 1 and
/// 2 times the one at which the optical axes meet. Of a camera in `kept`, such as those of a path's frame
/// before, it is a tenth lower: the choice changes where another is clearly better. Fewer cameras are
/// chosen from the start of the same sequence. Figures: docs/design-log/view-choice.md.
///
/// # Errors
///
/// [`TooFewViews`] if there are fewer than `count` of them.
pub fn choose_views(
    cameras: &[&Camera],
    target: &Camera,
    count: usize,
    kept: &[usize],
) -> Result<Vec<usize>, TooFewViews> {
    let mut pool = facing_alike(cameras, target);
    if pool.len() < count {
        return Err(TooFewViews { wanted: count, found: pool.len(), of: cameras.len() });
    }
    pool.truncate(POOL.max(count));
    let pooled: Vec<&Camera> = pool.iter().map(|&camera| cameras[camera]).collect();
    let points = points_before(target, focus(&pooled, target));
    let sees = |camera: &&Camera| points.iter().map(|&point| is_in_view(camera, point)).collect::<Vec<bool>>();
    let seen: Vec<Vec<bool>> = pooled.iter().map(sees).collect();
    // A camera in the target's place has no direction.
    let least = (ROUNDING * pooled.last().map_or(0.0, |camera| distance(camera, target))).max(f64::MIN_POSITIVE);
    let direction = |camera: &&Camera| (camera.centre() - target.centre()) / distance(camera, target).max(least);
    let directions: Vec<DVec3> = pooled.iter().map(direction).collect();
    let mut times_seen = vec![0; points.len()];
    let mut chosen: Vec<usize> = Vec::with_capacity(count);
    while chosen.len() < count {
        let cost = |camera: usize| {
            let alike = chosen.iter().map(|&other| directions[camera].dot(directions[other])).fold(0.0, f64::max);
            let worth = |(&sees, &times): (&bool, &usize)| if sees { WORTH[times.min(WORTH.len() - 1)] } else { 0.0 };
            let worth = seen[camera].iter().zip(&times_seen).map(worth).sum::<f64>() / points.len() as f64;
            let kept = if kept.contains(&pool[camera]) { KEPT } else { 1.0 };
            kept * distance(pooled[camera], target) * (1.0 + ALIKE * alike) / (worth + 1e-3).sqrt()
        };
        let free = (0..pool.len()).filter(|camera| !chosen.contains(camera));
        let costs: Vec<(usize, f64)> = free.map(|camera| (camera, cost(camera))).collect();
        let lowest = costs.iter().map(|&(_, cost)| cost).fold(f64::INFINITY, f64::min);
        let best = costs.iter().find(|&&(_, cost)| cost <= (1.0 + ROUNDING) * lowest).unwrap_or(&costs[0]).0;
        times_seen.iter_mut().zip(&seen[best]).for_each(|(times, &sees)| *times += usize::from(sees));
        chosen.push(best);
    }
    chosen.sort_unstable();
    Ok(chosen.into_iter().map(|camera| pool[camera]).collect())
}

/// The depth, scene units, at which the optical axes of the cameras come closest to the target's: the median of those
/// in front of both; ten times the cameras' median distance if that is at most half of them. At least that
/// distance.
fn focus(cameras: &[&Camera], target: &Camera) -> f64 {
    let (centre, forward) = (target.centre(), target.forward());
    let median = cameras.get(cameras.len() / 2).map_or(0.0, |camera| distance(camera, target));
    let depth = |camera: &&Camera| {
        let (apart, axis) = (centre - camera.centre(), camera.forward());
        let (cosine, a, b) = (forward.dot(axis), forward.dot(apart), axis.dot(apart));
        let squared_sine = 1.0 - cosine * cosine;
        let [depth, of_camera] = [cosine * b - a, b - cosine * a].map(|depth| depth / squared_sine);
        (squared_sine > 1e-6 && depth.min(of_camera) > 1e-6 * median).then_some(depth)
    };
    let mut depths: Vec<f64> = cameras.iter().filter_map(depth).collect();
    depths.sort_unstable_by(f64::total_cmp);
    let depth = if 2 * depths.len() > cameras.len() { depths[depths.len() / 2] } else { 10.0 * median };
    depth.max(median)
}

/// Points of the world at the target's pixels in a regular grid, at three depths about the given one.
fn points_before(target: &Camera, depth: f64) -> Vec<DVec3> {
    let (from_camera, from_pixel) = (target.rotation().transpose(), target.k_inverse());
    let at = |index: usize, size: usize| (index as f64 + 0.5) / GRID as f64 * size as f64;
    let pixel = |i: usize| DVec3::new(at(i % GRID, target.width()), at(i / GRID % GRID, target.height()), 1.0);
    let point = |i: usize| {
        let depth = DEPTHS[i / (GRID * GRID)] * depth;
        from_camera * (from_pixel * pixel(i) * depth - target.translation())
    };
    (0..DEPTHS.len() * GRID * GRID).map(point).collect()
}

/// Whether a point of the world lies in a camera's picture.
fn is_in_view(camera: &Camera, point: DVec3) -> bool {
    let at = camera.rotation() * point + camera.translation();
    let pixel = camera.k() * at / at.z;
    let [width, height] = [camera.width(), camera.height()].map(|side| side as f64);
    at.z > 0.0 && (0.0..width).contains(&pixel.x) && (0.0..height).contains(&pixel.y)
}

/// Indices of all cameras with optical axes within 60 degrees of the target's, nearest first (ties:
/// the earlier).
pub fn facing_alike(cameras: &[&Camera], target: &Camera) -> Vec<usize> {
    let mut facing: Vec<usize> =
        (0..cameras.len()).filter(|&i| cameras[i].forward().dot(target.forward()) > MIN_COSINE).collect();
    facing.sort_by(|&a, &b| distance(cameras[a], target).total_cmp(&distance(cameras[b], target)));
    facing
}

/// Index of the camera whose centre is nearest to a point (scene units); 0 if there are no cameras.
pub fn nearest_camera(cameras: &[&Camera], point: DVec3) -> usize {
    let distances = cameras.iter().map(|camera| camera.centre().distance(point)).enumerate();
    distances.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(index, _)| index)
}

/// Index of the camera nearest to the mean of all centres; 0 if there are no cameras.
pub fn middle_camera(cameras: &[&Camera]) -> usize {
    nearest_camera(cameras, cameras.iter().map(|camera| camera.centre()).sum::<DVec3>() / cameras.len() as f64)
}

/// Distance between the centres of two cameras, scene units.
pub fn distance(a: &Camera, b: &Camera) -> f64 {
    a.centre().distance(b.centre())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Intrinsics;

    /// A camera at (x, y, 0) that looks along +z, turned to the right by an angle (radians).
    fn camera(x: f64, y: f64, angle: f64) -> Camera {
        let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 60.0, cy: 40.0, skew: 0.0 };
        let rotation = glam::DMat3::from_rotation_y(-angle);
        Camera::new(intrinsics, 120, 80, rotation, -(rotation * DVec3::new(x, y, 0.0))).unwrap()
    }

    fn choice(cameras: &[Camera], target: &Camera, count: usize, kept: &[usize]) -> Vec<usize> {
        choose_views(&cameras.iter().collect::<Vec<_>>(), target, count, kept).unwrap()
    }

    #[test]
    fn views_are_chosen_from_all_sides() {
        let places = [(1.0, 0.0), (1.02, 0.01), (1.04, -0.01), (-1.1, 0.0), (0.0, 1.1), (9.0, 9.0)];
        let cameras = places.map(|(x, y)| camera(x, y, 0.0));
        let target = camera(0.0, 0.0, 0.0);
        assert_eq!(choice(&cameras, &target, 3, &[]), [0, 3, 4], "not the three nearest");
        assert_eq!(choice(&cameras, &target, 1, &[]), [0]);
        let at_the_target = camera(0.0, 0.0, 0.0);
        let cameras = [&cameras[..], &[at_the_target]].concat();
        assert_eq!(choice(&cameras, &target, 2, &[])[0], 6);
    }

    #[test]
    fn a_view_that_shows_another_part_of_the_scene_is_left_out() {
        // The nearest one is turned by 50 degrees: it shows little of the target.
        let cameras = [camera(0.5, 0.0, 0.87), camera(1.0, 0.0, 0.0), camera(-1.0, 0.1, 0.0)];
        assert_eq!(choice(&cameras, &camera(0.0, 0.0, 0.0), 2, &[]), [1, 2]);
    }

    #[test]
    fn views_are_kept_until_others_are_clearly_better() {
        let cameras: Vec<Camera> = (0..9).map(|k| camera(f64::from(k), 0.0, 0.0)).collect();
        let mut kept = choice(&cameras, &camera(0.0, 0.2, 0.0), 2, &[]);
        let (mut changes, mut free_changes, mut before) = (0, 0, kept.clone());
        // Forward, with steps back: without a margin the choice changes to and fro.
        for step in 0..400 {
            let target = camera(0.02 * f64::from(step) - 0.06 * f64::from(step % 2), 0.2, 0.0);
            let (chosen, free) = (choice(&cameras, &target, 2, &kept), choice(&cameras, &target, 2, &[]));
            changes += usize::from(chosen != kept);
            free_changes += usize::from(free != before);
            (kept, before) = (chosen, free);
        }
        assert!(changes < free_changes && changes > 4, "{changes} of {free_changes}");
    }

    #[test]
    fn the_choice_of_fewer_is_part_of_the_choice_of_more() {
        let cameras: Vec<Camera> =
            (0..12).map(|k| camera(f64::from(k * k % 7), f64::from(k % 5), 0.02 * f64::from(k))).collect();
        let target = camera(2.5, 2.5, 0.1);
        for count in 1..10 {
            let (few, more) = (choice(&cameras, &target, count, &[]), choice(&cameras, &target, count + 1, &[]));
            assert!(few.iter().all(|camera| more.contains(camera)), "{few:?} {more:?}");
            let distances = few.iter().map(|&camera| distance(&cameras[camera], &target));
            assert!(distances.is_sorted(), "{few:?}");
        }
    }
}
