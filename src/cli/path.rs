//! Camera paths around the rig.

use std::f64::consts::TAU;
use std::fmt;
use std::str::FromStr;

use anyhow::{Result, anyhow};
use glam::{DMat3, DVec3};
use liveview::camera::Camera;

use super::setup::Photos;

/// Turns of a spiral.
const TURNS: f64 = 2.0;

/// A shape and its number of frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct CameraPath {
    shape: Shape,
    frames: usize,
}

#[derive(Debug, Clone, Copy)]
enum Shape {
    Line,
    Circle,
    Spiral,
}

impl FromStr for CameraPath {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (shape, frames) = text.split_once(':').unwrap_or((text, ""));
        let shape = match shape {
            "line" => Shape::Line,
            "circle" => Shape::Circle,
            "spiral" => Shape::Spiral,
            _ => return Err("expected line:N, circle:N or spiral:N, with N frames".to_owned()),
        };
        Ok(Self { shape, frames: super::count(frames).map_err(|error| format!("N in {text}: {error}"))? })
    }
}

impl fmt::Display for CameraPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shape = match self.shape {
            Shape::Line => "line",
            Shape::Circle => "circle",
            Shape::Spiral => "spiral",
        };
        write!(f, "{shape}:{}", self.frames)
    }
}

impl CameraPath {
    /// Whether the last frame leads to the first.
    pub(super) fn is_closed(self) -> bool {
        !matches!(self.shape, Shape::Line)
    }

    /// The camera of each frame, with the intrinsics of the view in the middle of the rig.
    pub(super) fn cameras(self, photos: &Photos) -> Result<Vec<Camera>> {
        let views: Vec<&Camera> = photos.scene.views.iter().map(|view| &view.camera).collect();
        let rig = Rig::new(&views).ok_or_else(|| {
            anyhow!("the views look in opposite directions, so that a path has no middle; expected --pose instead")
        })?;
        let convergence = rig.convergence(&views);
        let ends = rig.ends(&views);
        let like = photos.nearest_view(rig.centre);
        let radius = rig.radius(&views);
        let camera = |frame: usize| {
            let part = frame as f64 / self.frames as f64;
            let offset = |size: f64, turns: f64| {
                let (sin, cos) = (TAU * turns * part).sin_cos();
                rig.centre + rig.rotation.transpose() * (size * DVec3::new(radius.x * cos, radius.y * sin, 0.0))
            };
            let centre = match self.shape {
                Shape::Line if self.frames == 1 => ends.0.midpoint(ends.1),
                Shape::Line => ends.0.lerp(ends.1, frame as f64 / (self.frames - 1) as f64),
                Shape::Circle => offset(1.0, 1.0),
                // Out and in again, so that the last frame leads to the first.
                Shape::Spiral => offset((0.5 * TAU * part).sin(), TURNS),
            };
            let rotation = rig.looking_from(centre, convergence);
            Ok(like.with_pose(rotation, -(rotation * centre))?)
        };
        (0..self.frames).map(camera).collect()
    }
}

/// The middle of the views.
pub(super) struct Rig {
    centre: DVec3,
    /// Rows: right, down, forward.
    pub(super) rotation: DMat3,
}

impl Rig {
    pub(super) fn new(views: &[&Camera]) -> Option<Self> {
        let mean = |of: fn(&Camera) -> DVec3| views.iter().map(|view| of(view)).sum::<DVec3>() / views.len() as f64;
        let rotation = facing(mean(|view| view.forward()), mean(|view| view.rotation().row(1)))?;
        Some(Self { centre: mean(Camera::centre), rotation })
    }

    /// 1 / distance of the point that the axes meet at, by least squares: 0 for parallel axes, negative where they part.
    fn convergence(&self, views: &[&Camera]) -> f64 {
        let across = |v: DVec3| (self.rotation * v).with_z(0.0);
        let pairs = views.iter().map(|view| (across(view.centre() - self.centre), across(view.forward())));
        let (turned, moved) = pairs
            .fold((0.0, 0.0), |sums, (offset, axis)| (sums.0 - axis.dot(offset), sums.1 + offset.length_squared()));
        if moved > 0.0 { turned / moved } else { 0.0 }
    }

    /// Turned with the offset from the middle as the views are, so that they see what a frame sees.
    fn looking_from(&self, centre: DVec3, convergence: f64) -> DMat3 {
        let forward = self.rotation.row(2) - convergence * (centre - self.centre);
        facing(forward, self.rotation.row(1)).unwrap_or(self.rotation)
    }

    /// Half the sides of an ellipse that stays among the views: root mean square distance from the middle, across and down.
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

/// The rotation that looks along `forward`, with `down` as near to down as that allows.
fn facing(forward: DVec3, down: DVec3) -> Option<DMat3> {
    let forward = forward.try_normalize()?;
    let right = down.cross(forward).try_normalize()?;
    Some(DMat3::from_rows(right, forward.cross(right), forward))
}

impl Photos {
    /// The camera of the view nearest to a point.
    pub(super) fn nearest_view(&self, point: DVec3) -> &Camera {
        &self.scene.views[self.nearest(point)].camera
    }

    /// The view nearest to the middle of the rig.
    pub(super) fn middle_view(&self) -> usize {
        let views = &self.scene.views;
        self.nearest(views.iter().map(|view| view.camera.centre()).sum::<DVec3>() / views.len() as f64)
    }

    fn nearest(&self, point: DVec3) -> usize {
        let views = self.scene.views.iter().map(|view| view.camera.centre().distance(point)).enumerate();
        views.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(view, _)| view)
    }
}

#[cfg(test)]
mod tests {
    use liveview::camera::Intrinsics;

    use super::*;

    fn camera(centre: DVec3, forward: DVec3) -> Camera {
        let k = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        let rotation = facing(forward, DVec3::Y).unwrap();
        Camera::new(k, 64, 48, rotation, -(rotation * centre)).unwrap()
    }

    /// A row of views along x, 2 wide, that look at a point straight ahead of its middle at that depth.
    fn rig(depth: f64) -> (Rig, f64) {
        let at = |x: f64| DVec3::new(x, 3.0, 0.0);
        let cameras = [-1.0, -0.5, 0.5, 1.0].map(|x| camera(at(x), at(0.0) + DVec3::Z * depth - at(x)));
        let views: Vec<&Camera> = cameras.iter().collect();
        let rig = Rig::new(&views).unwrap();
        let (convergence, ends) = (rig.convergence(&views), rig.ends(&views));
        assert!(ends.0.abs_diff_eq(at(-1.0), 1e-12) && ends.1.abs_diff_eq(at(1.0), 1e-12), "from left to right");
        (rig, convergence)
    }

    #[test]
    fn a_path_turns_as_the_views_do() {
        let (middle, convergence) = rig(20.0);
        assert!((convergence * 20.0 - 1.0).abs() < 0.01, "{convergence}");
        let forward = middle.looking_from(DVec3::new(1.0, 3.0, 0.0), convergence).row(2);
        assert!(forward.angle_between(DVec3::new(-1.0, 0.0, 20.0)) < 1e-3, "{forward}");
        let (middle, convergence) = rig(1e9);
        assert!(convergence.abs() < 1e-8, "{convergence}");
        assert!(middle.looking_from(DVec3::X, convergence).abs_diff_eq(DMat3::IDENTITY, 1e-7));
    }

    #[test]
    fn views_all_round_have_no_middle() {
        let views = [DVec3::X, -DVec3::X].map(|forward| camera(-forward, forward));
        assert!(Rig::new(&[&views[0], &views[1]]).is_none());
    }
}
