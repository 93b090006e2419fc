//! The choice of the views that a target is rendered from.

use glam::DVec3;

use super::camera::Camera;

/// Cosine of the largest angle (60 degrees) between the optical axes of a target and its views.
const MIN_COSINE: f64 = 0.5;

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

/// Indices of the `count` cameras nearest to the target, nearest first (ties: the earlier), among
/// those with optical axes within 60 degrees of the target's.
///
/// # Errors
///
/// [`TooFewViews`] if there are fewer than `count` of them.
pub fn choose_views(cameras: &[&Camera], target: &Camera, count: usize) -> Result<Vec<usize>, TooFewViews> {
    let mut facing = facing_alike(cameras, target);
    if facing.len() < count {
        return Err(TooFewViews { wanted: count, found: facing.len(), of: cameras.len() });
    }
    facing.truncate(count);
    Ok(facing)
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
