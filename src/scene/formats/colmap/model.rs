//! A sparse model as its files hold it, and what both encodings, binary and text, share.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use crate::geometry::{Camera, Intrinsics};
use crate::scene::error::SceneError;
use crate::scene::pose_file;
use crate::scene::undistort::Distortion;

/// A lens of the model, at the size of its photos.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Lens {
    pub(super) intrinsics: Intrinsics,
    pub(super) distortion: Distortion,
    pub(super) width: usize,
    pub(super) height: usize,
}

/// A registered photo.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Registered {
    pub(super) name: String,
    pub(super) camera: u32,
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    /// Keypoints with a 3D point: position in the photo as taken (pixels), id of the point.
    pub(super) tracked: Vec<(f64, f64, u64)>,
}

/// A sparse model.
#[derive(Debug, Default, PartialEq)]
pub(in crate::scene) struct Model {
    pub(super) lenses: HashMap<u32, Lens>,
    pub(super) images: Vec<Registered>,
    pub(super) points: HashMap<u64, DVec3>,
}

/// Reads one file of a model, given its path and bytes.
pub(in crate::scene) type Parse = fn(&Path, &[u8], &mut Model) -> Result<(), SceneError>;

/// Binary or text.
pub(in crate::scene) struct ModelFormat {
    /// Of its files' names.
    pub(super) ending: &'static str,
    pub(in crate::scene) cameras: Parse,
    pub(in crate::scene) images: Parse,
    pub(in crate::scene) points: Parse,
}

impl ModelFormat {
    pub(super) fn file(&self, folder: &Path, name: &str) -> PathBuf {
        folder.join(format!("{name}.{}", self.ending))
    }

    pub(super) fn is_in(&self, folder: &Path) -> bool {
        ["cameras", "images"].iter().all(|name| self.file(folder, name).is_file())
    }

    pub(super) fn read(&self, folder: &Path) -> Result<Model, SceneError> {
        let mut model = Model::default();
        for (name, parse) in [("cameras", self.cameras), ("images", self.images), ("points3D", self.points)] {
            let path = self.file(folder, name);
            if name != "points3D" || path.is_file() {
                parse(&path, &pose_file::read(&path)?, &mut model)?;
            }
        }
        Ok(model)
    }
}

/// Camera models by their number in binary files, with their number of parameters.
pub(super) const MODELS: [(&str, usize); 12] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
];

/// The lens of a camera model's parameters, or a refusal by name.
pub(super) fn lens(
    path: &Path,
    model: &str,
    width: usize,
    height: usize,
    parameters: &[f64],
) -> Result<Lens, SceneError> {
    let none = Distortion::default();
    let square = |f, cx, cy| Intrinsics { fx: f, fy: f, cx, cy, skew: 0.0 };
    let (intrinsics, distortion) = match (model, parameters) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => (square(f, cx, cy), none),
        ("PINHOLE", &[fx, fy, cx, cy]) => (Intrinsics { fx, fy, cx, cy, skew: 0.0 }, none),
        ("SIMPLE_RADIAL", &[f, cx, cy, k1]) => (square(f, cx, cy), Distortion { k1, ..none }),
        ("RADIAL", &[f, cx, cy, k1, k2]) => (square(f, cx, cy), Distortion { k1, k2, ..none }),
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => {
            (Intrinsics { fx, fy, cx, cy, skew: 0.0 }, Distortion { k1, k2, p1, p2, ..none })
        }
        ("SIMPLE_PINHOLE" | "PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV", _) => {
            let what = format!("a {model} camera with {} parameters", parameters.len());
            return Err(SceneError::malformed(path, what, "as many as the camera model has"));
        }
        _ => {
            let hint =
                "run COLMAP's image_undistorter first, or use PINHOLE, SIMPLE_RADIAL, RADIAL or OPENCV".to_owned();
            return Err(SceneError::Unsupported { path: path.to_owned(), what: format!("camera model {model}"), hint });
        }
    };
    // Checked here, where the file that holds the intrinsics is still known.
    let refused = |source| SceneError::Camera { path: path.to_owned(), image: format!("model {model}"), source };
    Camera::new(intrinsics, 1, 1, DMat3::IDENTITY, DVec3::ZERO).and(distortion.check()).map_err(refused)?;
    Ok(Lens { intrinsics, distortion, width, height })
}

/// Rotation of a quaternion w x y z of any length; NaN if it has none.
pub(super) fn rotation([w, x, y, z]: [f64; 4]) -> DMat3 {
    let length = (w * w + x * x + y * y + z * z).sqrt();
    let unit = DQuat::from_xyzw(x / length, y / length, z / length, w / length);
    // `DMat3::from_quat` asserts unit length in some builds; a bad quaternion must become an error instead.
    if length > 0.0 && unit.is_finite() { DMat3::from_quat(unit) } else { DMat3::NAN }
}
