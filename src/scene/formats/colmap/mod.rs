//! COLMAP sparse models: `cameras`, `images` and `points3D`, binary or text, in `sparse/0`, `sparse`, or the folder itself.
//!
//! Conventions are those of COLMAP's "Output Format" page: poses are `cam_from_world` (quaternion w x y z, then t), OpenCV
//! axes; intrinsics are in pixels with the first pixel's centre at (0.5, 0.5). Lens models up to OPENCV are undone on load,
//! all others refused by name. Photos that COLMAP did not register are named in the notes.
//!
//! Depth ranges come from each view's tracked points: 0.9 × their 1st and 1.1 × their 99th percentile of depth. The median
//! reprojection error of these points is told in a note: it shows at once whether poses and photos belong together.

pub(in crate::scene) mod binary;
pub(in crate::scene) mod text;

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use crate::geometry::{Camera, Intrinsics};
use crate::scene::draft::{Draft, Drafts, Size};
use crate::scene::files::{self, FindPhoto, images_folder, list_photos, photo, safe_name, some_of};
use crate::scene::undistort::Distortion;
use crate::scene::{SceneError, SceneOptions};

/// Fewer tracked points than this say nothing about a view's depth range.
const MIN_POINTS: usize = 8;

/// A lens of the model, at the size of its photos.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::scene) struct Lens {
    pub(in crate::scene) intrinsics: Intrinsics,
    pub(in crate::scene) distortion: Distortion,
    pub(in crate::scene) width: usize,
    pub(in crate::scene) height: usize,
}

/// A registered photo.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::scene) struct Registered {
    pub(in crate::scene) name: String,
    pub(in crate::scene) camera: u32,
    pub(in crate::scene) rotation: DMat3,
    pub(in crate::scene) translation: DVec3,
    /// Keypoints with a 3D point: position in the photo as taken (pixels), id of the point.
    pub(in crate::scene) tracked: Vec<(f64, f64, u64)>,
}

/// A sparse model.
#[derive(Debug, Default, PartialEq)]
pub(in crate::scene) struct Model {
    pub(in crate::scene) lenses: HashMap<u32, Lens>,
    pub(in crate::scene) images: Vec<Registered>,
    pub(in crate::scene) points: HashMap<u64, DVec3>,
}

/// Reads one file of a model, given its path and bytes.
type Parse = fn(&Path, &[u8], &mut Model) -> Result<(), SceneError>;

/// Binary or text.
pub(in crate::scene) struct ModelFormat {
    /// Of its files' names.
    pub(in crate::scene) ending: &'static str,
    pub(in crate::scene) cameras: Parse,
    pub(in crate::scene) images: Parse,
    pub(in crate::scene) points: Parse,
}

impl ModelFormat {
    fn file(&self, folder: &Path, name: &str) -> PathBuf {
        folder.join(format!("{name}.{}", self.ending))
    }

    fn is_in(&self, folder: &Path) -> bool {
        ["cameras", "images"].iter().all(|name| self.file(folder, name).is_file())
    }

    fn read(&self, folder: &Path) -> Result<Model, SceneError> {
        let mut model = Model::default();
        for (name, parse) in [("cameras", self.cameras), ("images", self.images), ("points3D", self.points)] {
            let path = self.file(folder, name);
            if name != "points3D" || path.is_file() {
                parse(&path, &files::read(&path)?, &mut model)?;
            }
        }
        Ok(model)
    }
}

/// Camera models by their number in binary files, with their number of parameters.
pub(in crate::scene) const MODELS: [(&str, usize); 12] = [
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
pub(in crate::scene) fn lens(
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
pub(in crate::scene) fn rotation([w, x, y, z]: [f64; 4]) -> DMat3 {
    let length = (w * w + x * x + y * y + z * z).sqrt();
    let unit = DQuat::from_xyzw(x / length, y / length, z / length, w / length);
    // `DMat3::from_quat` asserts unit length in some builds; a bad quaternion must become an error instead.
    if length > 0.0 && unit.is_finite() { DMat3::from_quat(unit) } else { DMat3::NAN }
}

/// The folder of the model, and its format.
pub(in crate::scene) fn model_folder(root: &Path) -> Option<(PathBuf, ModelFormat)> {
    let folders = ["sparse/0", "sparse", "", "colmap/sparse/0"].map(|folder| root.join(folder));
    folders.into_iter().find_map(|folder| {
        let format = [binary::FORMAT, text::FORMAT].into_iter().find(|format| format.is_in(&folder))?;
        Some((folder, format))
    })
}

pub(in crate::scene) fn open(root: &Path, options: &SceneOptions) -> Result<Drafts, SceneError> {
    let Some((folder, format)) = model_folder(root) else {
        return Err(SceneError::malformed(root, "no COLMAP model", "sparse/0 with cameras and images, .bin or .txt"));
    };
    let model = format.read(&folder)?;
    let listed_in = format.file(&folder, "images");
    let photos = images_folder(root, options.images.as_deref(), &["images", "images_2", "images_4", "images_8"])?;
    // Reduced copies may come with another extension.
    let find = |name: &str| photo(root, &listed_in, name, photos != "images");
    let mut found = drafts(&listed_in, &model, &photos, &find)?;
    found.notes.extend(unregistered(root, &photos, &found.drafts)?);
    Ok(found)
}

/// From the photos in the folder `photos`.
pub(in crate::scene) fn drafts(
    listed_in: &Path,
    model: &Model,
    photos: &str,
    find: FindPhoto<'_>,
) -> Result<Drafts, SceneError> {
    let mut notes = Vec::new();
    let mut drafts = Vec::with_capacity(model.images.len());
    let mut errors = Vec::new();
    for image in &model.images {
        let Some(lens) = model.lenses.get(&image.camera) else {
            let what = format!("image {} has camera {}, which is not listed", image.name, image.camera);
            return Err(SceneError::malformed(listed_in, what, "the number of a camera of this model"));
        };
        let name = safe_name(listed_in, &image.name)?;
        let photo = find(&format!("{photos}/{name}"))?;
        // Reduced copies have another size by design.
        let original = photos == "images";
        let (depths, worst) = depths_and_errors(image, lens, &model.points);
        errors.extend(worst);
        drafts.push(Draft {
            photo,
            intrinsics: lens.intrinsics,
            size: if original { Size::Exactly(lens.width, lens.height) } else { Size::Scaled(lens.width, lens.height) },
            rotation: image.rotation,
            translation: image.translation,
            distortion: lens.distortion,
            depth_range: depth_range(depths),
        });
    }
    if photos != "images" {
        notes.push(format!("photos are those of {photos}"));
    }
    notes.extend(reprojection(errors));
    if model.points.is_empty() {
        notes.push("no points3D: depth ranges are unknown".to_owned());
    }
    Ok(Drafts { cameras: listed_in.to_owned(), drafts, notes })
}

/// Depths of the tracked points in front of the camera, and their reprojection errors in pixels.
fn depths_and_errors(image: &Registered, lens: &Lens, points: &HashMap<u64, DVec3>) -> (Vec<f64>, Vec<f64>) {
    let Intrinsics { fx, fy, cx, cy, .. } = lens.intrinsics;
    let seen = image.tracked.iter().filter_map(|&(u, v, id)| {
        let point = image.rotation * *points.get(&id)? + image.translation;
        let (x, y) = lens.distortion.distort(point.x / point.z, point.y / point.z);
        (point.z > 0.0).then(|| (point.z, (fx * x + cx - u).hypot(fy * y + cy - v)))
    });
    seen.unzip()
}

fn depth_range(mut depths: Vec<f64>) -> Option<(f64, f64)> {
    if depths.len() < MIN_POINTS {
        return None;
    }
    depths.sort_by(f64::total_cmp);
    Some((0.9 * percentile(&depths, 0.01), 1.1 * percentile(&depths, 0.99)))
}

/// Percentile of sorted values, interpolated linearly between ranks as NumPy does.
fn percentile(sorted: &[f64], fraction: f64) -> f64 {
    let rank = fraction * (sorted.len() - 1) as f64;
    let (low, high) = (sorted[rank as usize], sorted[rank.ceil() as usize]);
    low + (high - low) * rank.fract()
}

fn unregistered(root: &Path, photos: &str, drafts: &[Draft]) -> Result<Option<String>, SceneError> {
    let known: HashSet<&str> = drafts.iter().map(|draft| draft.photo.name.as_str()).collect();
    let mut names = list_photos(&root.join(photos))?;
    names.retain(|name| !known.contains(format!("{photos}/{name}").as_str()));
    Ok((!names.is_empty())
        .then(|| format!("{} photos were not registered by COLMAP, skipped: {}", names.len(), some_of(&names))))
}

fn reprojection(mut errors: Vec<f64>) -> Option<String> {
    errors.sort_by(f64::total_cmp);
    let median = errors.get(errors.len() / 2)?;
    let warning = if *median > 2.0 { ": poses or photos may not belong together" } else { "" };
    Some(format!("median reprojection error of {} tracked points: {median:.2} px{warning}", errors.len()))
}
