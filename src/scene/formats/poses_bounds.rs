//! `poses_bounds.npy`, the pose file of LLFF and of rigs that use its format.
//!
//! One row of 17 f64 per camera: a 3×5 matrix, row by row, then near and far depth. The columns of
//! the matrix are the camera's axes in world coordinates [down, right, backwards], its centre, and
//! (height, width, focal length) of the full-size photos (LLFF's README, "Using your own poses").
//! OpenCV's axes are [right, down, −backwards]. The principal point is the image centre.

use std::path::Path;

use glam::{DMat3, DVec3};
use ndarray::ArrayView2;

use crate::fs::npy;
use crate::geometry::{Intrinsics, Size};
use crate::scene::error::SceneError;

/// One row of the file.
pub(in crate::scene) struct PoseBounds {
    /// In pixels of `size`.
    pub(in crate::scene) intrinsics: Intrinsics,
    /// Declared size of the full-size photos, in pixels.
    pub(in crate::scene) size: Size,
    /// `cam_from_world`, OpenCV axes.
    pub(in crate::scene) rotation: DMat3,
    pub(in crate::scene) translation: DVec3,
    /// Bounds of the depth as stored, in scene units; not checked.
    pub(in crate::scene) near: f64,
    pub(in crate::scene) far: f64,
}

pub(in crate::scene) fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<PoseBounds>, SceneError> {
    const EXPECTED: &str = "a float64 array of N rows with 17 numbers";
    let rows: ArrayView2<'_, f64> = npy::view(bytes).map_err(|what| SceneError::malformed(path, what, EXPECTED))?;
    if rows.ncols() != 17 {
        return Err(SceneError::malformed(path, format!("the array has shape {:?}", rows.shape()), EXPECTED));
    }
    rows.rows().into_iter().enumerate().map(|(index, row)| pose_bounds(path, index, |i| row[i])).collect()
}

fn pose_bounds(path: &Path, index: usize, at: impl Fn(usize) -> f64) -> Result<PoseBounds, SceneError> {
    let column = |i: usize| DVec3::new(at(i), at(5 + i), at(10 + i));
    let (down, right, backwards, centre) = (column(0), column(1), column(2), column(3));
    let side = |name: &str, value: f64| {
        let is_valid = value.fract() == 0.0 && (1.0..=1e9).contains(&value);
        let wrong =
            || SceneError::malformed(path, format!("row {index}: {name} is {value}"), "a whole number of pixels");
        is_valid.then_some(value as usize).ok_or_else(wrong)
    };
    let (height, width, focal) = (side("height", at(4))?, side("width", at(9))?, at(14));
    let rotation = DMat3::from_rows(right, down, -backwards);
    let (cx, cy) = (0.5 * width as f64, 0.5 * height as f64);
    Ok(PoseBounds {
        intrinsics: Intrinsics { fx: focal, fy: focal, cx, cy, skew: 0.0 },
        size: Size::new(width, height),
        rotation,
        translation: -(rotation * centre),
        near: at(15),
        far: at(16),
    })
}
