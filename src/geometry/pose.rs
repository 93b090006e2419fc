//! Relative pose of two cameras, and poses with OpenGL's axes.

use glam::{DMat3, DVec3};

use super::camera::Camera;

/// `X_source = rotation · X_target + translation`, between the axes of two cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelativePose {
    /// Rotation `source_from_target`.
    pub rotation: DMat3,
    /// Translation `source_from_target`, in scene units.
    pub translation: DVec3,
}

/// The pose of the target in the source camera: R = R_s R_tᵀ, t = t_s − R t_t.
pub fn source_from_target(source: &Camera, target: &Camera) -> RelativePose {
    let rotation = source.rotation() * target.rotation().transpose();
    RelativePose { rotation, translation: source.translation() - rotation * target.translation() }
}

/// `cam_from_world` (rotation, translation) with OpenCV axes, of a camera given by its axes (the
/// columns of `axes`, OpenGL: x right, y up, z backwards) and its centre in the world.
pub(crate) fn cam_from_opengl_world(axes: DMat3, centre: DVec3) -> (DMat3, DVec3) {
    // The rows of `cam_from_world` are the columns of world from camera; y and z are opposite.
    let rotation = DMat3::from_rows(axes.x_axis, -axes.y_axis, -axes.z_axis);
    (rotation, -(rotation * centre))
}
