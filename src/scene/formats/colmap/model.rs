//! A sparse model, and what its binary and text encodings have in common.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use crate::geometry::{Camera, Intrinsics};
use crate::scene::error::SceneError;
use crate::scene::pose_file;
use crate::scene::undistort::Distortion;

/// The intrinsics and distortion of one of the model's cameras, at the size of its photos in
/// pixels.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Lens {
    pub(super) intrinsics: Intrinsics,
    pub(super) distortion: Distortion,
    pub(super) width: usize,
    pub(super) height: usize,
}

/// A registered photo; its pose is `cam_from_world`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Registered {
    pub(super) name: String,
    pub(super) camera: u32,
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    /// Keypoints with a 3D point: position in the distorted photo (pixels), id of the point.
    pub(super) tracked: Vec<(f64, f64, u64)>,
}

/// A sparse model.
#[derive(Debug, Default, PartialEq)]
pub(in crate::scene) struct Model {
    pub(super) lenses: HashMap<u32, Lens>,
    pub(super) images: Vec<Registered>,
    pub(super) points: HashMap<u64, DVec3>,
}

/// Adds the contents of one file, given its path and bytes, to a model.
pub(in crate::scene) type Parse = fn(&Path, &[u8], &mut Model) -> Result<(), SceneError>;

/// An encoding of a model, binary or text.
pub(in crate::scene) struct ModelFormat {
    /// File extension.
    pub(super) extension: &'static str,
    pub(in crate::scene) cameras: Parse,
    pub(in crate::scene) images: Parse,
    pub(in crate::scene) points: Parse,
}

impl ModelFormat {
    pub(super) fn file(&self, folder: &Path, name: &str) -> PathBuf {
        folder.join(format!("{name}.{}", self.extension))
    }

    pub(super) fn is_in(&self, folder: &Path) -> bool {
        ["cameras", "images"].iter().all(|name| self.file(folder, name).is_file())
    }

    pub(in crate::scene::formats) fn read(&self, folder: &Path) -> Result<Model, SceneError> {
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

/// Camera models and their numbers of parameters, indexed by the model number in binary files.
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

/// Those that are read.
const READ_MODELS: [&str; 9] = [
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "FULL_OPENCV",
    "OPENCV_FISHEYE",
    "RADIAL_FISHEYE",
    "SIMPLE_RADIAL_FISHEYE",
];

/// A lens from a camera model's name and parameters; an error for unsupported models.
pub(super) fn lens(
    path: &Path,
    model: &str,
    width: usize,
    height: usize,
    parameters: &[f64],
) -> Result<Lens, SceneError> {
    let pixels = |fx, fy, cx, cy| Intrinsics { fx, fy, cx, cy, skew: 0.0 };
    let bent = |k, p| Distortion { fisheye: model.ends_with("FISHEYE"), k, p };
    let (intrinsics, distortion) = match (model, parameters) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => (pixels(f, f, cx, cy), Distortion::default()),
        ("PINHOLE", &[fx, fy, cx, cy]) => (pixels(fx, fy, cx, cy), Distortion::default()),
        ("SIMPLE_RADIAL" | "SIMPLE_RADIAL_FISHEYE", &[f, cx, cy, k1]) => {
            (pixels(f, f, cx, cy), bent([k1, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 2]))
        }
        ("RADIAL" | "RADIAL_FISHEYE", &[f, cx, cy, k1, k2]) => {
            (pixels(f, f, cx, cy), bent([k1, k2, 0.0, 0.0, 0.0, 0.0], [0.0; 2]))
        }
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => {
            (pixels(fx, fy, cx, cy), bent([k1, k2, 0.0, 0.0, 0.0, 0.0], [p1, p2]))
        }
        ("OPENCV_FISHEYE", &[fx, fy, cx, cy, k1, k2, k3, k4]) => {
            (pixels(fx, fy, cx, cy), bent([k1, k2, k3, k4, 0.0, 0.0], [0.0; 2]))
        }
        ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) => {
            (pixels(fx, fy, cx, cy), bent([k1, k2, k3, k4, k5, k6], [p1, p2]))
        }
        _ if READ_MODELS.contains(&model) => {
            let what = format!("a {model} camera with {} parameters", parameters.len());
            return Err(SceneError::malformed(path, what, "the camera model's number of parameters"));
        }
        _ => {
            let hint = format!("run COLMAP's image_undistorter first, or use {}", READ_MODELS.join(", "));
            return Err(SceneError::Unsupported { path: path.to_owned(), what: format!("camera model {model}"), hint });
        }
    };
    // Checked here, so that the error names the file that holds the intrinsics.
    let refused = |source| SceneError::Camera { path: path.to_owned(), image: format!("model {model}"), source };
    Camera::new(intrinsics, 1, 1, DMat3::IDENTITY, DVec3::ZERO).and(distortion.check()).map_err(refused)?;
    Ok(Lens { intrinsics, distortion, width, height })
}

/// Rotation from a quaternion w x y z of any length; NaN if the length is 0 or not finite.
pub(super) fn rotation([w, x, y, z]: [f64; 4]) -> DMat3 {
    let length = (w * w + x * x + y * y + z * z).sqrt();
    let unit = DQuat::from_xyzw(x / length, y / length, z / length, w / length);
    // `DMat3::from_quat` panics on other lengths in some builds; NaN becomes an error later.
    if length > 0.0 && unit.is_finite() { DMat3::from_quat(unit) } else { DMat3::NAN }
}
