//! Cameras, and the positions of the pixels of one in another: the plane sweep.
//!
//! For target pixel p and disparity δ: (u, v, w) = H∞ p + δ e, with H∞ = K_s R K_t⁻¹ and e = K_s t;
//! the source pixel is (u/w, v/w), in front of the source camera iff w > 0. Exact at δ = 0, without
//! 1/δ, the inverse of a homography or a division by h33 (paper, section "HWV").

mod camera;
mod matrix;
mod view_selection;

use std::fmt;

use glam::{DMat3, DVec3};

pub use camera::{Camera, CameraError, Intrinsics};
pub use matrix::{cam_from_opengl_world, rotation_and_translation};
pub use view_selection::{TooFewViews, choose_views, distance, facing_alike, middle_camera, nearest_camera};

/// Largest side of an image or a camera, in pixels.
pub const MAX_SIDE: usize = 16_384;

/// Width and height in pixels (in cells where documented).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Size {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Size {
    /// Of that width and height.
    pub const fn new(width: usize, height: usize) -> Self {
        Self { width, height }
    }

    /// Width times height.
    pub const fn pixels(self) -> usize {
        self.width * self.height
    }
}

/// `504x352`
impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

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

/// The sweep of one view over the target's disparities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneSweep {
    /// H∞: source pixel from target pixel at disparity 0, homogeneous.
    pub homography_at_infinity: DMat3,
    /// e: change of (u, v, w) per unit of disparity.
    pub epipole: DVec3,
}

impl PlaneSweep {
    /// The sweep of `source` for the pixels of `target`.
    pub fn new(source: &Camera, target: &Camera) -> Self {
        let pose = source_from_target(source, target);
        Self {
            homography_at_infinity: source.k() * pose.rotation * target.k_inverse(),
            epipole: source.k() * pose.translation,
        }
    }

    /// The homography of the plane at `disparity` (1/scene unit): source pixel from target pixel,
    /// homogeneous. w > 0 is in front of the source camera; do not normalise the matrix by its last
    /// element, which may change that sign.
    pub fn source_from_target(&self, disparity: f64) -> DMat3 {
        let mut homography = self.homography_at_infinity;
        homography.z_axis += disparity * self.epipole;
        homography
    }

    /// The same sweep between images shrunk by a factor of `scale`, with their corners aligned.
    pub fn shrunk(&self, scale: f64) -> Self {
        let down = DVec3::new(1.0 / scale, 1.0 / scale, 1.0);
        let up = DMat3::from_diagonal(DVec3::new(scale, scale, 1.0));
        Self {
            homography_at_infinity: DMat3::from_diagonal(down) * self.homography_at_infinity * up,
            epipole: down * self.epipole,
        }
    }
}
