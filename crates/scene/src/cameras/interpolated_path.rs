//! A camera path through given cameras.

use glam::{DMat3, DQuat, DVec3};
use liveview::geometry::{Camera, CameraError};

/// `frames` cameras that pass through all of these in order, as many frames from each to the next:
/// centres on a Catmull-Rom spline, rotations by the shortest turn. Intrinsics and size are those of
/// the first.
///
/// # Errors
///
/// [`CameraError`] if a frame's camera is not usable, where centres are too large for their spline.
///
/// # Panics
///
/// If there are no cameras.
pub fn interpolated_path(cameras: &[&Camera], frames: usize) -> Result<Vec<Camera>, CameraError> {
    let (centres, last): (Vec<DVec3>, _) = (cameras.iter().map(|camera| camera.centre()).collect(), cameras.len() - 1);
    let turns: Vec<DQuat> = cameras.iter().map(|camera| DQuat::from_mat3(&camera.rotation()).normalize()).collect();
    let camera = |frame: usize| {
        let at = if frames > 1 { (frame * last) as f64 / (frames - 1) as f64 } else { 0.0 };
        let from = (at as usize).min(last.saturating_sub(1));
        let (to, part) = ((from + 1).min(last), at - from as f64);
        let (a, b) = (centres[from], centres[to]);
        // Beyond the ends, the path goes on as it begins and ends.
        let before = if from > 0 { centres[from - 1] } else { 2.0 * a - b };
        let after = centres.get(to + 1).copied().unwrap_or(2.0 * b - a);
        let centre = spline([before, a, b, after], part);
        let rotation = DMat3::from_quat(turns[from].slerp(turns[to], part).normalize());
        cameras[0].with_pose(rotation, -(rotation * centre))
    };
    (0..frames).map(camera).collect()
}

/// The Catmull-Rom spline from the second of four points to the third.
fn spline([before, a, b, after]: [DVec3; 4], part: f64) -> DVec3 {
    let (speed, square) = (b - before, 2.0 * before - 5.0 * a + 4.0 * b - after);
    a + 0.5 * part * (speed + part * (square + part * (3.0 * (a - b) + after - before)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use liveview::geometry::Intrinsics;

    fn camera(centre: DVec3, angle: f64) -> Camera {
        let k = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        let rotation = DMat3::from_rotation_y(angle);
        Camera::new(k, 64, 48, rotation, -(rotation * centre)).unwrap()
    }

    #[test]
    fn path_passes_through_every_camera_without_a_kink() {
        let cameras = [(0.0, 0.0, 0.0), (1.0, 2.0, 0.3), (3.0, 2.5, -3.0), (3.5, 0.0, 3.0)];
        let cameras = cameras.map(|(x, z, angle)| camera(DVec3::new(x, 0.5, z), angle));
        let views: Vec<&Camera> = cameras.iter().collect();
        let path = interpolated_path(&views, 3001).unwrap();
        for (frame, view) in [0, 1000, 2000, 3000].into_iter().zip(&views) {
            assert!(path[frame].centre().abs_diff_eq(view.centre(), 1e-12), "{frame}");
            assert!(path[frame].rotation().abs_diff_eq(view.rotation(), 1e-12), "{frame}");
        }
        let steps: Vec<DVec3> = path.windows(2).map(|pair| pair[1].centre() - pair[0].centre()).collect();
        for pair in steps.windows(2) {
            assert!((pair[1] - pair[0]).length() < 0.01 * pair[0].length(), "{pair:?}");
        }
        // From −3 to 3 radians the shortest turn is not through 0.
        let widest = path[2500].forward().dot(DMat3::from_rotation_y(std::f64::consts::PI).row(2));
        assert!(widest > 0.999, "{widest}");
    }

    #[test]
    fn one_frame_or_one_camera_is_a_path() {
        let (a, b) = (camera(DVec3::ZERO, 0.1), camera(DVec3::X, 0.2));
        assert!(interpolated_path(&[&a, &b], 1).unwrap()[0].centre().length() < 1e-15);
        let still = interpolated_path(&[&b], 3).unwrap();
        assert!(still.len() == 3 && still.iter().all(|camera| camera.centre().abs_diff_eq(DVec3::X, 1e-15)));
    }
}
