//! Pinhole cameras, in f64.
//!
//! Camera axes are OpenCV's: x right, y down, z forward. A pose is `cam_from_world`: `X_cam = R
//! X_world + t`, in scene units. Intrinsics are in pixels, and the centre of the pixel in column i,
//! row j is (i + 0.5, j + 0.5).

use glam::{DMat3, DVec3};

use super::{MAX_SIDE, Size};

/// Focal lengths, principal point and skew, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Horizontal focal length.
    pub fx: f64,
    /// Vertical focal length.
    pub fy: f64,
    /// Column of the principal point; columns range from 0 to the image width.
    pub cx: f64,
    /// Row of the principal point; rows range from 0 to the image height.
    pub cy: f64,
    /// Skew: K's entry in row 0, column 1. Nearly always 0.
    pub skew: f64,
}

impl Intrinsics {
    /// Those of a picture resampled by these factors.
    fn scaled(self, across: f64, down: f64) -> Self {
        let Self { fx, fy, cx, cy, skew } = self;
        Self { fx: fx * across, fy: fy * down, cx: cx * across, cy: cy * down, skew: skew * across }
    }
}

/// Largest intrinsics, pixels, and the reciprocal of the smallest focal length: products of four have room in f64.
const MAX_PIXELS: f64 = 1e75;

/// A pinhole camera: intrinsics, image size and pose. Always valid: [`Camera::new`] checks its
/// fields, which are private.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    intrinsics: Intrinsics,
    width: usize,
    height: usize,
    rotation: DMat3,
    translation: DVec3,
}

impl Camera {
    /// A camera from its intrinsics (pixels), image size (pixels) and pose (`cam_from_world`, scene
    /// units).
    ///
    /// The rotation is used as given, never re-orthonormalised, so that the Rust and the Python
    /// implementation compute from the same values.
    ///
    /// # Errors
    ///
    /// [`CameraError`] for a non-finite field, a K without an inverse, a matrix that is not a
    /// rotation, or a bad size.
    pub fn new(
        intrinsics: Intrinsics,
        width: usize,
        height: usize,
        rotation: DMat3,
        translation: DVec3,
    ) -> Result<Self, CameraError> {
        let camera = Self { intrinsics, width, height, rotation, translation };
        if ![width, height].iter().all(|side| (1..=MAX_SIDE).contains(side)) {
            return Err(CameraError::Size { size: camera.size() });
        }
        camera.check_intrinsics()?;
        camera.check_pose()?;
        Ok(camera)
    }

    fn check_intrinsics(&self) -> Result<(), CameraError> {
        let Intrinsics { fx, fy, cx, cy, skew } = self.intrinsics;
        for (field, value) in [("fx", fx), ("fy", fy), ("cx", cx), ("cy", cy), ("skew", skew)] {
            finite(|| field.to_owned(), value)?;
        }
        if let Some((field, value)) = [("fx", fx), ("fy", fy)].into_iter().find(|&(_, value)| value < 1.0 / MAX_PIXELS)
        {
            return Err(CameraError::SingularK { field, value });
        }
        let all = [("fx", fx), ("fy", fy), ("cx", cx), ("cy", cy), ("skew", skew)];
        match all.into_iter().find(|(_, value)| value.abs() > MAX_PIXELS) {
            Some((field, value)) => Err(CameraError::TooLarge { field, value }),
            None => Ok(()),
        }
    }

    fn check_pose(&self) -> Result<(), CameraError> {
        for row in 0..3 {
            for column in 0..3 {
                let value = self.rotation.row(row)[column];
                finite(|| format!("rotation[{row}][{column}]"), value)?;
            }
            finite(|| format!("translation[{row}]"), self.translation[row])?;
        }
        // Bounds the squared distance of two cameras on opposite sides of the origin.
        let square = 4.0 * self.centre().length_squared();
        finite(|| "the squared distance of the centre from its opposite".to_owned(), square)?;
        let residual = self.rotation * self.rotation.transpose() - DMat3::IDENTITY;
        let residual = residual.to_cols_array().map(f64::abs);
        let determinant = self.rotation.determinant();
        // Written so that NaN, after an overflow, is refused too.
        if !residual.iter().all(|&x| x <= ROTATION_TOLERANCE) || determinant < 0.0 {
            let deviation = residual.into_iter().fold(0.0, f64::max);
            return Err(CameraError::NotARotation { deviation, determinant });
        }
        Ok(())
    }

    /// The intrinsics, in pixels.
    pub fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    /// Image width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Image height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Image size in pixels.
    pub fn size(&self) -> Size {
        Size::new(self.width, self.height)
    }

    /// K: pixels from camera rays.
    pub fn k(&self) -> DMat3 {
        let Intrinsics { fx, fy, cx, cy, skew } = self.intrinsics;
        DMat3::from_rows(DVec3::new(fx, skew, cx), DVec3::new(0.0, fy, cy), DVec3::new(0.0, 0.0, 1.0))
    }

    /// K⁻¹ in closed form: camera rays (z = 1) from pixels. Its last row is exactly (0, 0, 1).
    pub fn k_inverse(&self) -> DMat3 {
        let Intrinsics { fx, fy, cx, cy, skew } = self.intrinsics;
        DMat3::from_rows(
            DVec3::new(1.0 / fx, -skew / fx / fy, (skew / fy * cy - cx) / fx),
            DVec3::new(0.0, 1.0 / fy, -cy / fy),
            DVec3::new(0.0, 0.0, 1.0),
        )
    }

    /// R of `cam_from_world`: its rows are the camera's right, down and forward in the world.
    pub fn rotation(&self) -> DMat3 {
        self.rotation
    }

    /// t of `cam_from_world`, in scene units.
    pub fn translation(&self) -> DVec3 {
        self.translation
    }

    /// Camera centre in the world, in scene units: −Rᵀt.
    pub fn centre(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// Optical axis in the world: the last row of R.
    pub fn forward(&self) -> DVec3 {
        self.rotation.row(2)
    }

    /// The same camera for its image resampled to `width` × `height`: K is scaled by the actual
    /// ratio of each axis.
    ///
    /// # Errors
    ///
    /// [`CameraError`] if the size or the scaled K is not usable.
    pub fn with_size_scaled(&self, width: usize, height: usize) -> Result<Self, CameraError> {
        let across = width as f64 / self.width as f64;
        let down = height as f64 / self.height as f64;
        Self::new(self.intrinsics.scaled(across, down), width, height, self.rotation, self.translation)
    }

    /// The camera of a photo whose cells of `cell`×`cell` pixels are averaged, fewer at the right and
    /// lower edge.
    pub fn shrunk(&self, cell: usize) -> Self {
        let (width, height) = (self.width.div_ceil(cell), self.height.div_ceil(cell));
        let scale = |cells: usize| cells as f64 / (cells * cell) as f64;
        // Not checked again: MAX_PIXELS leaves room for K of all smaller sizes and their inverses.
        Self { intrinsics: self.intrinsics.scaled(scale(width), scale(height)), width, height, ..self.clone() }
    }

    /// The same camera for a window of its image plane: a crop, or (negative `left` and `top`,
    /// larger size) a padded image. `left` and `top` are in pixels of this camera.
    ///
    /// # Errors
    ///
    /// [`CameraError::Size`] if the size is not usable.
    pub fn with_window(&self, left: f64, top: f64, width: usize, height: usize) -> Result<Self, CameraError> {
        let Intrinsics { cx, cy, .. } = self.intrinsics;
        let shifted = Intrinsics { cx: cx - left, cy: cy - top, ..self.intrinsics };
        Self::new(shifted, width, height, self.rotation, self.translation)
    }

    /// The same camera with another horizontal field of view, in degrees between 0 and 180: a zoom
    /// about the principal point.
    ///
    /// # Errors
    ///
    /// [`CameraError::SingularK`] for other angles.
    pub fn with_field_of_view(&self, degrees: f64) -> Result<Self, CameraError> {
        let Intrinsics { fx, fy, skew, .. } = self.intrinsics;
        let zoom = 0.5 * self.width as f64 / (0.5 * degrees).to_radians().tan() / fx;
        let zoomed = Intrinsics { fx: fx * zoom, fy: fy * zoom, skew: skew * zoom, ..self.intrinsics };
        Self::new(zoomed, self.width, self.height, self.rotation, self.translation)
    }

    /// The same intrinsics and size with another pose: `cam_from_world` rotation and translation.
    ///
    /// # Errors
    ///
    /// [`CameraError`] if the pose is not finite or not a rotation.
    pub fn with_pose(&self, rotation: DMat3, translation: DVec3) -> Result<Self, CameraError> {
        Self::new(self.intrinsics, self.width, self.height, rotation, translation)
    }
}

fn finite(field: impl Fn() -> String, value: f64) -> Result<(), CameraError> {
    if value.is_finite() { Ok(()) } else { Err(CameraError::NotFinite { field: field(), value }) }
}

/// Largest entry of `|R Rᵀ − I|` accepted for a rotation: pose files carry as few as three
/// decimals.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// Why a camera was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// NaN or infinity in a field.
    #[error("{field} is {value}: expected a finite number")]
    NotFinite {
        /// The field, such as `fx` or `rotation[0][2]`.
        field: String,
        /// Its value.
        value: f64,
    },
    /// K has no usable inverse.
    #[error("K is singular: {field} is {value:?}, expected a positive focal length in pixels")]
    SingularK {
        /// `fx` or `fy`.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// An intrinsic parameter that no picture has.
    #[error("{field} is {value:?}: expected at most 1e75 pixels")]
    TooLarge {
        /// `fx`, `fy`, `cx`, `cy` or `skew`.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// The rotation's rows are not orthonormal, or it mirrors.
    #[error(
        "the rotation is not orthonormal: max |R Rᵀ − I| is {deviation:.3e} (at most {ROTATION_TOLERANCE:.0e} \
         is accepted), det R is {determinant:.6}{}", if *determinant < 0.0 { ": it mirrors, as left-handed axes do" } else { "" }
    )]
    NotARotation {
        /// The largest entry of `|R Rᵀ − I|`.
        deviation: f64,
        /// det R; negative for a mirror.
        determinant: f64,
    },
    /// A matrix has not the form of its kind.
    #[error("{matrix} is not as expected: {expected}")]
    Matrix {
        /// K or the pose.
        matrix: &'static str,
        /// Its form.
        expected: &'static str,
    },
    /// A width or height of zero, or one beyond [`MAX_SIDE`].
    #[error("the image size is {size}: each side must be 1 to {MAX_SIDE} pixels")]
    Size {
        /// In pixels.
        size: Size,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::source_from_target;

    const K: Intrinsics = Intrinsics { fx: 700.0, fy: 650.0, cx: 320.5, cy: 240.25, skew: 1.5 };

    fn camera() -> Camera {
        let rotation = DMat3::from_axis_angle(DVec3::new(2.0, -1.0, 0.5).normalize(), 0.7);
        Camera::new(K, 640, 480, rotation, DVec3::new(0.3, -1.0, 2.0)).unwrap()
    }

    fn refused(intrinsics: Intrinsics, width: usize, rotation: DMat3, translation: DVec3) -> String {
        Camera::new(intrinsics, width, 480, rotation, translation).unwrap_err().to_string()
    }

    #[test]
    fn k_inverse_times_k_is_the_identity() {
        let product = camera().k() * camera().k_inverse();
        assert!(product.abs_diff_eq(DMat3::IDENTITY, 1e-12), "{product}");
        assert_eq!(camera().k_inverse().row(2), DVec3::Z);
    }

    #[test]
    fn centre_maps_to_the_origin_and_forward_to_z() {
        let camera = camera();
        let origin = camera.rotation() * camera.centre() + camera.translation();
        assert!(origin.length() < 1e-14, "{origin}");
        let ahead = camera.rotation() * (camera.centre() + camera.forward()) + camera.translation();
        assert!(ahead.abs_diff_eq(DVec3::Z, 1e-14), "{ahead}");
    }

    #[test]
    fn source_from_target_maps_target_points_to_the_source() {
        let (source, target) = (camera(), camera().with_pose(DMat3::from_rotation_y(0.2), DVec3::X).unwrap());
        let world = DVec3::new(0.4, 0.7, 5.0);
        let pose = source_from_target(&source, &target);
        let through = pose.rotation * (target.rotation() * world + target.translation()) + pose.translation;
        let direct = source.rotation() * world + source.translation();
        assert!(through.abs_diff_eq(direct, 1e-14), "{through} {direct}");
    }

    #[test]
    fn scaled_and_windowed_cameras_move_pixels_with_the_image() {
        let camera = camera();
        let ray = DVec3::new(0.1, -0.2, 1.0);
        let pixel = camera.k() * ray;
        // 640x480 -> 320x120: each axis by its own ratio.
        let scaled = camera.with_size_scaled(320, 120).unwrap();
        assert!((scaled.k() * ray).abs_diff_eq(pixel * DVec3::new(0.5, 0.25, 1.0), 1e-12));
        let window = camera.with_window(-8.0, 3.0, 656, 470).unwrap();
        assert!((window.k() * ray).abs_diff_eq(pixel + DVec3::new(8.0, -3.0, 0.0), 1e-12));
        assert_eq!((window.width(), window.height()), (656, 470));
    }

    #[test]
    fn field_of_view_scales_about_the_principal_point() {
        let camera = camera();
        let wide = camera.with_field_of_view(90.0).unwrap();
        let Intrinsics { fx, fy, cx, cy, skew } = wide.intrinsics();
        assert!((fx - 320.0).abs() < 1e-9 && (fy / fx - 650.0 / 700.0).abs() < 1e-12, "{fx} {fy}");
        assert!((skew / fx - 1.5 / 700.0).abs() < 1e-12 && (cx, cy) == (K.cx, K.cy));
        assert_eq!((wide.size(), wide.rotation()), (camera.size(), camera.rotation()));
        assert!(camera.with_field_of_view(-10.0).unwrap_err().to_string().contains("fx is"));
    }

    #[test]
    fn new_invalid_field_is_named_in_the_error() {
        let (r, t) = (DMat3::IDENTITY, DVec3::ZERO);
        let message = refused(Intrinsics { cx: f64::NAN, ..K }, 640, r, t);
        assert_eq!(message, "cx is NaN: expected a finite number");
        let message = refused(Intrinsics { fy: 0.0, ..K }, 640, r, t);
        assert_eq!(message, "K is singular: fy is 0.0, expected a positive focal length in pixels");
        assert!(refused(Intrinsics { fx: -700.0, ..K }, 640, r, t).contains("fx is -700"));
        assert!(refused(Intrinsics { fx: 1e-320, ..K }, 640, r, t).contains("K is singular: fx"));
        assert!(refused(Intrinsics { fy: 1e-308, ..K }, 640, r, t).contains("K is singular: fy"));
        assert!(
            refused(Intrinsics { skew: -1e76, ..K }, 640, r, t).starts_with("skew is -1e76: expected at most 1e75")
        );
        assert!(refused(K, 640, r, DVec3::new(0.0, f64::INFINITY, 0.0)).starts_with("translation[1] is inf"));
        let far = DVec3::new(0.0, 6e153, 0.0);
        let [here, there] = [far, -far].map(|translation| Camera::new(K, 640, 480, r, translation).unwrap().centre());
        assert!(here.distance_squared(there).is_finite());
        assert!(refused(K, 640, r, 1.2 * far).starts_with("the squared distance of the centre"));
        let mut rotation = r;
        rotation.y_axis.x = f64::NAN;
        assert!(refused(K, 640, rotation, t).starts_with("rotation[0][1] is NaN"));
        assert!(refused(K, 0, r, t).starts_with("the image size is 0x480"));
        assert!(refused(K, MAX_SIDE + 1, r, t).starts_with("the image size is 16385x480"));
    }

    #[test]
    fn all_smaller_sizes_of_a_valid_camera_have_an_inverse() {
        let ends = [1.0 / MAX_PIXELS, MAX_PIXELS];
        for [fx, fy, cx, skew] in ends.iter().flat_map(|&fx| ends.map(|fy| [fx, fy, -MAX_PIXELS, MAX_PIXELS])) {
            let intrinsics = Intrinsics { fx, fy, cx, cy: MAX_PIXELS, skew };
            let camera = Camera::new(intrinsics, MAX_SIDE, 1, DMat3::IDENTITY, DVec3::ZERO).unwrap();
            for cell in [1, 2, 8, 64, MAX_SIDE] {
                let shrunk = camera.shrunk(cell).shrunk(cell);
                assert!(shrunk.k_inverse().to_cols_array().iter().all(|x| x.is_finite()), "{intrinsics:?} {cell}");
            }
        }
    }

    #[test]
    fn new_matrix_that_is_no_rotation_is_an_error() {
        let message = refused(K, 640, DMat3::IDENTITY * 1.1, DVec3::ZERO);
        assert!(message.contains("max |R Rᵀ − I| is 2.100e-1 (at most 1e-3 is accepted)"), "{message}");
        let mirror = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
        assert!(refused(K, 640, mirror, DVec3::ZERO).contains("det R is -1"));
        let rounded = DMat3::from_diagonal(DVec3::new(1.0004, 1.0, 1.0));
        assert!(Camera::new(K, 640, 480, rounded, DVec3::ZERO).is_ok());
    }

    #[test]
    fn shrunk_camera_sees_a_point_in_the_cell_of_its_pixel() {
        let (camera, ray) = (camera(), DVec3::new(0.1, -0.2, 1.0));
        for (cell, size) in [(2, (320, 240)), (7, (92, 69))] {
            let shrunk = camera.shrunk(cell);
            assert_eq!((shrunk.width(), shrunk.height()), size);
            let expected = camera.k() * ray * DVec3::new(1.0 / cell as f64, 1.0 / cell as f64, 1.0);
            assert!((shrunk.k() * ray).abs_diff_eq(expected, 1e-12), "{cell}");
        }
    }
}
