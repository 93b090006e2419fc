//! A sparse model, and what its binary and text encodings have in common.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use crate::undistort::{Distortion, FISHEYES, PINHOLES};
use crate::{SceneError, pose_file};
use liveview::geometry::{Camera, Intrinsics, Size};

/// The intrinsics and distortion of one of the model's cameras, and the size of its photos in
/// pixels.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Lens {
    pub(super) intrinsics: Intrinsics,
    pub(super) distortion: Distortion,
    pub(super) size: Size,
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
pub(in crate::formats) struct Model {
    pub(super) lenses: HashMap<u32, Lens>,
    pub(super) images: Vec<Registered>,
    pub(super) points: HashMap<u64, DVec3>,
}

/// Adds the contents of one file, given its path and bytes, to a model.
pub(in crate::formats) type Parse = fn(&Path, &[u8], &mut Model) -> Result<(), SceneError>;

/// An encoding of a model, binary or text.
pub(in crate::formats) struct ModelFormat {
    /// File extension.
    pub(super) extension: &'static str,
    pub(in crate::formats) cameras: Parse,
    pub(in crate::formats) images: Parse,
    pub(in crate::formats) points: Parse,
}

impl ModelFormat {
    pub(super) fn file(&self, folder: &Path, name: &str) -> PathBuf {
        folder.join(format!("{name}.{}", self.extension))
    }

    pub(super) fn is_in(&self, folder: &Path) -> bool {
        ["cameras", "images"].iter().all(|name| self.file(folder, name).is_file())
    }

    pub(in crate::formats) fn read(&self, folder: &Path) -> Result<Model, SceneError> {
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

/// A lens from a camera model's name and parameters; an error for unsupported models.
pub(super) fn lens(path: &Path, model: &str, size: Size, parameters: &[f64]) -> Result<Lens, SceneError> {
    let fisheye = FISHEYES.contains(&model);
    if !fisheye && !PINHOLES.contains(&model) {
        let read = [&PINHOLES[..], &FISHEYES].concat().join(", ");
        let hint = format!("run COLMAP's image_undistorter first, or use {read}");
        return Err(SceneError::Unsupported { path: path.to_owned(), what: format!("camera model {model}"), hint });
    }
    if !MODELS.contains(&(model, parameters.len())) {
        let what = format!("a {model} camera with {} parameters", parameters.len());
        return Err(SceneError::malformed(path, what, "the camera model's number of parameters"));
    }
    // One focal length or two, the principal point, then the first coefficients of FULL_OPENCV's. A
    // fisheye has k3 and k4 in place of p1 and p2.
    let has_one_focal_length = model.starts_with("SIMPLE") || model.starts_with("RADIAL");
    let (focal, rest) = parameters.split_at(if has_one_focal_length { 1 } else { 2 });
    let (centre, given) = rest.split_at(2);
    let intrinsics = Intrinsics { fx: focal[0], fy: focal[focal.len() - 1], cx: centre[0], cy: centre[1], skew: 0.0 };
    let mut coefficients = [0.0; 8];
    coefficients[..given.len()].copy_from_slice(given);
    let [k1, k2, p1, p2, k3, k4, k5, k6] = coefficients;
    let distortion = match fisheye {
        true => Distortion { fisheye, k: [k1, k2, p1, p2, 0.0, 0.0], p: [0.0; 2] },
        false => Distortion { fisheye, k: [k1, k2, k3, k4, k5, k6], p: [p1, p2] },
    };
    // Checked here, so that the error names the file that holds the intrinsics.
    let refused = |source| SceneError::Camera { path: path.to_owned(), image: format!("model {model}"), source };
    Camera::new(intrinsics, 1, 1, DMat3::IDENTITY, DVec3::ZERO).and(distortion.check()).map_err(refused)?;
    Ok(Lens { intrinsics, distortion, size })
}

/// Rotation from a quaternion w x y z of any length; NaN if the length is 0 or not finite.
pub(super) fn rotation([w, x, y, z]: [f64; 4]) -> DMat3 {
    let length = (w * w + x * x + y * y + z * z).sqrt();
    let unit = DQuat::from_xyzw(x / length, y / length, z / length, w / length);
    // `DMat3::from_quat` panics on other lengths in some builds; NaN becomes an error later.
    if length > 0.0 && unit.is_finite() { DMat3::from_quat(unit) } else { DMat3::NAN }
}
