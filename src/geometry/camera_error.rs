//! Why a camera was refused.

use super::size::{MAX_SIDE, Size};

/// Largest entry of `|R Rᵀ − I|` accepted for a rotation: pose files carry as few as three
/// decimals.
pub(super) const ROTATION_TOLERANCE: f64 = 1e-3;

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
    /// The rotation's rows are not orthonormal, or it mirrors.
    #[error(
        "the rotation is not orthonormal: max |R Rᵀ − I| is {deviation:.3e} (at most {ROTATION_TOLERANCE:.0e} \
         is accepted), det R is {determinant:.6}"
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
