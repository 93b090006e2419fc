//! Poses from OpenGL's axes.

use glam::{DMat3, DVec3};

/// `cam_from_world` (rotation, translation) with OpenCV axes, of a camera whose pose is given as world from camera with OpenGL
/// axes (x right, y up, z backwards): the columns of its rotation are `axes`, its centre is `centre`.
pub(crate) fn cam_from_opengl_world(axes: DMat3, centre: DVec3) -> (DMat3, DVec3) {
    // The rows of `cam_from_world` are the columns of world from camera; y and z point the other way.
    let rotation = DMat3::from_rows(axes.x_axis, -axes.y_axis, -axes.z_axis);
    (rotation, -(rotation * centre))
}
