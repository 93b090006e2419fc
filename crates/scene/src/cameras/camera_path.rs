//! Camera paths through given cameras, or around the views: a line, a circle or a spiral about their mean pose, facing the
//! point that the views' optical axes converge on.

use std::f64::consts::TAU;
use std::str::FromStr;

use glam::{DMat3, DQuat, DVec3};

use liveview::geometry::{Camera, CameraError, nearest_camera};

/// Largest number of frames of a path.
const MAX_FRAMES: usize = 4096;

/// Number of turns of a spiral.
const SPIRAL_TURNS: f64 = 2.0;

/// A shape and its number of frames, written `line:N`, `circle:N` or `spiral:N`: N cameras between
/// the two outermost views, or around the mean of all of them, rotating as the views do.
#[derive(Debug, Clone, Copy)]
pub struct CameraPath {
    shape: Shape,
    frames: usize,
}

/// Why there is no path.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CameraPathError {
    /// The views' directions cancel out.
    #[error("the views face in opposite directions: expected views with a mean direction to make a path around")]
    NoMeanDirection,
    /// A frame's camera is not usable.
    #[error(transparent)]
    Camera(#[from] CameraError),
}

#[derive(Debug, Clone, Copy)]
enum Shape {
    Line,
    Circle,
    Spiral,
}

/// The shapes, by their names.
const SHAPES: [(&str, Shape); 3] = [("line", Shape::Line), ("circle", Shape::Circle), ("spiral", Shape::Spiral)];

impl FromStr for CameraPath {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (shape, frames) = text.split_once(':').unwrap_or((text, ""));
        let known = SHAPES.into_iter().find(|(name, _)| *name == shape);
        let (_, shape) = known.ok_or("expected line:N, circle:N or spiral:N, with N frames")?;
        let frames = frames.parse().ok().filter(|frames| (1..=MAX_FRAMES).contains(frames));
        let wrong = || format!("N in {text}: expected a whole number from 1 to {MAX_FRAMES}");
        Ok(Self { shape, frames: frames.ok_or_else(wrong)? })
    }
}

impl CameraPath {
    /// Whether the path continues from the last frame to the first.
    pub fn is_closed(self) -> bool {
        !matches!(self.shape, Shape::Line)
    }

    /// The camera of each frame, with the intrinsics and the size of the view nearest to the mean
    /// pose.
    ///
    /// # Errors
    ///
    /// [`CameraPathError::NoMeanDirection`] where the views' directions cancel out;
    /// [`CameraPathError::Camera`] if a frame's camera is not usable.
    ///
    /// # Panics
    ///
    /// If there are no views.
    pub fn cameras(self, views: &[&Camera]) -> Result<Vec<Camera>, CameraPathError> {
        let mean = MeanPose::new(views).ok_or(CameraPathError::NoMeanDirection)?;
        let convergence = mean.convergence(views);
        let ends = mean.ends(views);
        let like = views[nearest_camera(views, mean.centre)];
        let radius = mean.radius(views);
        let camera = |frame: usize| {
            let part = frame as f64 / self.frames as f64;
            let offset = |size: f64, turns: f64| {
                let (sin, cos) = (TAU * turns * part).sin_cos();
                mean.centre + mean.rotation.transpose() * (size * DVec3::new(radius.x * cos, radius.y * sin, 0.0))
            };
            let centre = match self.shape {
                Shape::Line if self.frames == 1 => ends.0.midpoint(ends.1),
                Shape::Line => ends.0.lerp(ends.1, frame as f64 / (self.frames - 1) as f64),
                Shape::Circle => offset(1.0, 1.0),
                // Outwards and back, so that the path continues from the last frame to the first.
                Shape::Spiral => offset((0.5 * TAU * part).sin(), SPIRAL_TURNS),
            };
            let rotation = mean.looking_from(centre, convergence);
            Ok(like.with_pose(rotation, -(rotation * centre))?)
        };
        (0..self.frames).map(camera).collect()
    }
}

/// The mean of the views' poses.
#[derive(Debug, Clone, Copy)]
pub struct MeanPose {
    /// Mean of the centres, scene units.
    pub centre: DVec3,
    /// Rows: right, down, forward, in the world.
    pub rotation: DMat3,
}

impl MeanPose {
    /// The mean pose of these views; `None` where their forward or their down directions cancel
    /// out.
    pub fn new(views: &[&Camera]) -> Option<Self> {
        let mean = |of: fn(&Camera) -> DVec3| views.iter().map(|view| of(view)).sum::<DVec3>() / views.len() as f64;
        let rotation = facing(mean(|view| view.forward()), mean(|view| view.rotation().row(1)))?;
        Some(Self { centre: mean(Camera::centre), rotation })
    }

    /// 1 / distance (1/scene unit) of the point that the axes converge on, by least squares: 0 for
    /// parallel axes, negative where they diverge.
    fn convergence(&self, views: &[&Camera]) -> f64 {
        let across = |v: DVec3| (self.rotation * v).with_z(0.0);
        let pairs = views.iter().map(|view| (across(view.centre() - self.centre), across(view.forward())));
        let (products, squares) = pairs
            .fold((0.0, 0.0), |sums, (offset, axis)| (sums.0 - axis.dot(offset), sums.1 + offset.length_squared()));
        if squares > 0.0 { products / squares } else { 0.0 }
    }

    /// The rotation of a frame at `centre`: it faces the views' point of convergence.
    fn looking_from(&self, centre: DVec3, convergence: f64) -> DMat3 {
        let forward = self.rotation.row(2) - convergence * (centre - self.centre);
        facing(forward, self.rotation.row(1)).unwrap_or(self.rotation)
    }

    /// Semi-axes (scene units) of an ellipse among the views: their root mean square distance from
    /// the mean, across and down.
    fn radius(&self, views: &[&Camera]) -> DVec3 {
        let square = |view: &&Camera| (self.rotation * (view.centre() - self.centre)).powf(2.0);
        (views.iter().map(square).sum::<DVec3>() / views.len() as f64).powf(0.5)
    }

    /// The two views furthest apart, the left one first.
    fn ends(&self, views: &[&Camera]) -> (DVec3, DVec3) {
        let pairs = views.iter().enumerate().flat_map(|(i, a)| views[i..].iter().map(|b| (a.centre(), b.centre())));
        let (a, b) =
            pairs.max_by(|x, y| x.0.distance(x.1).total_cmp(&y.0.distance(y.1))).unwrap_or((self.centre, self.centre));
        if (b - a).dot(self.rotation.row(0)) < 0.0 { (b, a) } else { (a, b) }
    }
}

/// The rotation with that forward axis, and the down axis nearest to `down`.
fn facing(forward: DVec3, down: DVec3) -> Option<DMat3> {
    let forward = forward.try_normalize()?;
    let right = down.cross(forward).try_normalize()?;
    Some(DMat3::from_rows(right, forward.cross(right), forward))
}

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
mod camera_path_tests {
    use super::*;
    use liveview::geometry::Intrinsics;

    fn camera(centre: DVec3, forward: DVec3) -> Camera {
        let k = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        let rotation = facing(forward, DVec3::Y).unwrap();
        Camera::new(k, 64, 48, rotation, -(rotation * centre)).unwrap()
    }

    /// A row of views along x, 2 wide, that face a point straight ahead of its middle at that
    /// depth.
    fn rig(depth: f64) -> (MeanPose, f64) {
        let at = |x: f64| DVec3::new(x, 3.0, 0.0);
        let cameras = [-1.0, -0.5, 0.5, 1.0].map(|x| camera(at(x), at(0.0) + DVec3::Z * depth - at(x)));
        let views: Vec<&Camera> = cameras.iter().collect();
        let rig = MeanPose::new(&views).unwrap();
        let (convergence, ends) = (rig.convergence(&views), rig.ends(&views));
        assert!(ends.0.abs_diff_eq(at(-1.0), 1e-12) && ends.1.abs_diff_eq(at(1.0), 1e-12), "from left to right");
        (rig, convergence)
    }

    #[test]
    fn looking_from_faces_the_point_of_convergence() {
        let (middle, convergence) = rig(20.0);
        assert!((convergence * 20.0 - 1.0).abs() < 0.01, "{convergence}");
        let forward = middle.looking_from(DVec3::new(1.0, 3.0, 0.0), convergence).row(2);
        assert!(forward.angle_between(DVec3::new(-1.0, 0.0, 20.0)) < 1e-3, "{forward}");
        let (middle, convergence) = rig(1e9);
        assert!(convergence.abs() < 1e-8, "{convergence}");
        assert!(middle.looking_from(DVec3::X, convergence).abs_diff_eq(DMat3::IDENTITY, 1e-7));
    }

    #[test]
    fn mean_pose_of_opposite_views_is_none() {
        let views = [DVec3::X, -DVec3::X].map(|forward| camera(-forward, forward));
        assert!(MeanPose::new(&[&views[0], &views[1]]).is_none());
    }
}

#[cfg(test)]
mod interpolated_path_tests {
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

    #[test]
    fn rotations_turn_at_a_constant_speed() {
        let cameras = [0.0, 2.0].map(|angle| camera(DVec3::ZERO, angle));
        let path = interpolated_path(&[&cameras[0], &cameras[1]], 9).unwrap();
        for (frame, camera) in path.iter().enumerate() {
            let expected = DMat3::from_rotation_y(2.0 * frame as f64 / 8.0);
            assert!(camera.rotation().abs_diff_eq(expected, 1e-12), "{frame}: {}", camera.rotation());
        }
    }
}
