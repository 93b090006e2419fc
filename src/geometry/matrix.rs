//! Cameras from K and a pose as matrices, and poses with OpenGL's axes.

use glam::{DMat3, DVec3};

use super::{Camera, CameraError, Intrinsics, Size};

/// The last row of a pose.
const LAST_ROW: [f64; 4] = [0.0, 0.0, 0.0, 1.0];

impl Camera {
    /// A camera from K (pixels) and `cam_from_world` with OpenCV's axes (x right, y down, z forward;
    /// scene units), both row by row, and the size of its picture in pixels.
    ///
    /// ```
    /// # use liveview::{Camera, geometry::Size};
    /// let k = [[800.0, 0.0, 320.0], [0.0, 800.0, 240.0], [0.0, 0.0, 1.0]];
    /// let cam_from_world = [[1.0, 0.0, 0.0, -0.1], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 2.0], [0.0, 0.0, 0.0, 1.0]];
    /// let camera = Camera::from_opencv(k, cam_from_world, Size::new(640, 480))?;
    /// assert_eq!(camera.centre().to_array(), [0.1, 0.0, -2.0]);
    /// # Ok::<(), liveview::geometry::CameraError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`CameraError::Matrix`] for a row of K or of the pose that is not as in the others; those of
    /// [`Camera::new`].
    pub fn from_opencv(k: [[f64; 3]; 3], cam_from_world: [[f64; 4]; 4], size: Size) -> Result<Self, CameraError> {
        let (rotation, translation) = rotation_and_translation(cam_from_world)?;
        Self::new(intrinsics(k)?, size.width, size.height, rotation, translation)
    }

    /// A camera from K (pixels) and `world_from_cam` with OpenGL's axes (x right, y up, z backwards;
    /// scene units), as nerfstudio and Blender have it, both row by row, and the size of its picture
    /// in pixels.
    ///
    /// # Errors
    ///
    /// As [`Self::from_opencv`].
    pub fn from_opengl(k: [[f64; 3]; 3], world_from_cam: [[f64; 4]; 4], size: Size) -> Result<Self, CameraError> {
        let (axes, centre) = rotation_and_translation(world_from_cam)?;
        let (rotation, translation) = cam_from_opengl_world(axes, centre);
        Self::new(intrinsics(k)?, size.width, size.height, rotation, translation)
    }
}

fn intrinsics([[fx, skew, cx], [below, fy, cy], last]: [[f64; 3]; 3]) -> Result<Intrinsics, CameraError> {
    match (below, last) {
        (0.0, [0.0, 0.0, 1.0]) => Ok(Intrinsics { fx, fy, cx, cy, skew }),
        _ => Err(CameraError::Matrix { matrix: "K", expected: "[fx, skew, cx], [0, fy, cy], [0, 0, 1]" }),
    }
}

/// Rotation and translation of a 4×4 pose, row by row.
///
/// # Errors
///
/// [`CameraError::Matrix`] unless the last row is 0 0 0 1.
pub fn rotation_and_translation([a, b, c, last]: [[f64; 4]; 4]) -> Result<(DMat3, DVec3), CameraError> {
    if last != LAST_ROW {
        return Err(CameraError::Matrix { matrix: "the pose", expected: "a last row of [0, 0, 0, 1]" });
    }
    let column = |i: usize| DVec3::new(a[i], b[i], c[i]);
    Ok((DMat3::from_cols(column(0), column(1), column(2)), column(3)))
}

/// `cam_from_world` (rotation, translation) with OpenCV axes, of a camera given by its axes (the
/// columns of `axes`, OpenGL: x right, y up, z backwards) and its centre in the world.
pub fn cam_from_opengl_world(axes: DMat3, centre: DVec3) -> (DMat3, DVec3) {
    // The rows of `cam_from_world` are the columns of world from camera; y and z are opposite.
    let rotation = DMat3::from_rows(axes.x_axis, -axes.y_axis, -axes.z_axis);
    (rotation, -(rotation * centre))
}

#[cfg(test)]
mod tests {
    use super::*;

    const K: [[f64; 3]; 3] = [[50.0, 0.5, 32.0], [0.0, 60.0, 24.0], [0.0, 0.0, 1.0]];

    #[test]
    fn both_conventions_give_the_same_camera() {
        // Turned by a quarter about y: forward is the world's x. The centre is (1, 2, 3).
        let opencv = [[0.0, 0.0, -1.0, 3.0], [0.0, 1.0, 0.0, -2.0], [1.0, 0.0, 0.0, -1.0], LAST_ROW];
        let opengl = [[0.0, 0.0, -1.0, 1.0], [0.0, -1.0, 0.0, 2.0], [-1.0, 0.0, 0.0, 3.0], LAST_ROW];
        let size = Size::new(64, 48);
        let camera = Camera::from_opencv(K, opencv, size).unwrap();
        assert_eq!((camera.centre(), camera.forward()), (DVec3::new(1.0, 2.0, 3.0), DVec3::X));
        assert_eq!(camera.k(), DMat3::from_cols_array_2d(&K).transpose());
        assert_eq!(Camera::from_opengl(K, opengl, size).unwrap(), camera);
    }

    #[test]
    fn matrices_of_another_form_are_refused() {
        let (size, unit) =
            (Size::new(64, 48), [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], LAST_ROW]);
        let refused = |k, pose| Camera::from_opengl(k, pose, size).unwrap_err().to_string();
        let transposed = [[50.0, 0.0, 0.0], [0.0, 60.0, 0.0], [32.0, 24.0, 1.0]];
        assert_eq!(refused(transposed, unit), "K is not as expected: [fx, skew, cx], [0, fy, cy], [0, 0, 1]");
        let mut pose = unit;
        pose[3][0] = 7.0;
        assert_eq!(refused(K, pose), "the pose is not as expected: a last row of [0, 0, 0, 1]");
        pose = unit;
        pose[0][0] = 2.0;
        assert!(refused(K, pose).contains("not orthonormal"));
    }
}
