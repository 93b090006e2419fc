//! COLMAP sparse models: `cameras`, `images` and `points3D`, binary or text, in `sparse/0`,
//! `sparse`, or the folder itself.
//!
//! Conventions are those of COLMAP's "Output Format" page: poses are `cam_from_world` (quaternion w
//! x y z, then t), OpenCV axes; intrinsics are in pixels with the first pixel's centre at (0.5,
//! 0.5). Photos of the radial, OpenCV and fisheye camera models are undistorted on load; models that
//! are not are refused by name. The notes list the photos that COLMAP did not register.
//!
//! A view's depth range comes from its tracked points: 0.9 × the 1st and 1.1 × the 99th percentile
//! of their depths. A note reports the median reprojection error of these points, since a large one
//! means that poses and photos do not belong together.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use crate::photos::{PhotoLookup, list_photos};
use crate::scene_file::{self, abbreviated, safe_name};
use crate::undistort::{FISHEYES, PINHOLES};
use crate::{DeclaredView, DeclaredViews, Distortion, PhotoList, PhotoSource, SceneError, SceneOptions};
use liveview::geometry::{Camera, Intrinsics, Size};

pub(crate) mod binary;
pub(crate) mod text;

/// Tracked points that a view needs for a depth range.
const MIN_POINTS: usize = 8;

/// Where a sparse model may lie, in order of precedence.
const MODEL_FOLDERS: [&str; 4] = ["sparse/0", "sparse", "", "colmap/sparse/0"];

/// The folder of the sparse model, and its format.
pub(crate) fn model_folder(root: &Path) -> Option<(PathBuf, ModelFormat)> {
    MODEL_FOLDERS.map(|folder| root.join(folder)).into_iter().find_map(|folder| {
        let format = [binary::FORMAT, text::FORMAT].into_iter().find(|format| format.is_in(&folder))?;
        Some((folder, format))
    })
}

/// The folder of a sparse model that lacks files, if there is one.
pub(crate) fn incomplete_model(root: &Path) -> Option<&'static str> {
    MODEL_FOLDERS.into_iter().find(|folder| !folder.is_empty() && root.join(folder).is_dir())
}

pub(crate) fn open(root: &Path, photos: &dyn PhotoSource, options: &SceneOptions) -> Result<DeclaredViews, SceneError> {
    let Some((folder, format)) = model_folder(root) else {
        return Err(SceneError::malformed(root, "no COLMAP model", "sparse/0 with cameras and images, .bin or .txt"));
    };
    let model = format.read(&folder)?;
    let listed_in = format.file(&folder, "images");
    let list = list_photos(root, photos, options.images.as_deref(), &["images", "images_2", "images_4", "images_8"])?;
    let mut found = views(&model, &list, PhotoLookup::new(photos, &listed_in))?;
    found.notes.extend(unregistered(&list, &found.views));
    Ok(found)
}

/// Views of the listed photos.
pub(crate) fn views(model: &Model, list: &PhotoList, mut lookup: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
    let listed_in = lookup.listed_in;
    // Downscaled copies differ in size from the model's photos, and may differ in extension.
    let downscaled = list.folder.as_deref().filter(|&folder| folder != "images");
    let mut errors = Vec::new();
    for image in &model.images {
        let Some(lens) = model.lenses.get(&image.camera) else {
            let what = format!("image {} has camera {}, which is not listed", image.name, image.camera);
            return Err(SceneError::malformed(listed_in, what, "the number of a camera of this model"));
        };
        let name = safe_name(listed_in, &image.name)?;
        let Some(photo) = lookup.find(&list.with_folder(&name))? else { continue };
        let (depths, view_errors) = depths_and_errors(image, lens, &model.points);
        errors.extend(view_errors);
        lookup.views.push(DeclaredView {
            photo,
            intrinsics: lens.intrinsics,
            size: lens.size,
            may_be_resampled: downscaled.is_some(),
            rotation: image.rotation,
            translation: image.translation,
            distortion: lens.distortion,
            depth_range: depth_range(depths),
        });
    }
    let mut found = lookup.finish()?;
    found.notes.extend(downscaled.map(|folder| format!("photos are read from {folder}")));
    found.notes.extend(reprojection_note(errors));
    if model.points.is_empty() {
        found.notes.push("no points3D, which would give the depth range".to_owned());
    }
    Ok(found)
}

/// What a model says of one of its photos.
pub(crate) struct Seen {
    /// Centre of its camera, in units of the model.
    pub(crate) centre: DVec3,
    /// Range of the depths of its points.
    pub(crate) range: Option<(f64, f64)>,
}

/// What a model says of its photos, by name.
pub(crate) fn seen(model: &Model) -> HashMap<&str, Seen> {
    let seen = model.images.iter().filter_map(|image| {
        let (depths, _) = depths_and_errors(image, model.lenses.get(&image.camera)?, &model.points);
        let centre = -(image.rotation.transpose() * image.translation);
        Some((image.name.as_str(), Seen { centre, range: depth_range(depths) }))
    });
    seen.collect()
}

/// The note on photos that COLMAP did not register.
fn unregistered(list: &PhotoList, views: &[DeclaredView]) -> Option<String> {
    let registered: HashSet<&str> = views.iter().map(|view| view.photo.name.as_str()).collect();
    let is_unregistered = |name: &&String| !registered.contains(list.with_folder(name).as_str());
    let names: Vec<String> = list.names.iter().filter(is_unregistered).cloned().collect();
    (!names.is_empty())
        .then(|| format!("{} photos were not registered by COLMAP, skipped: {}", names.len(), abbreviated(&names)))
}

/// Depths of the tracked points in front of the camera, and their reprojection errors in pixels.
fn depths_and_errors(image: &Registered, lens: &Lens, points: &HashMap<u64, DVec3>) -> (Vec<f64>, Vec<f64>) {
    let Intrinsics { fx, fy, cx, cy, .. } = lens.intrinsics;
    let projected = image.tracked.iter().filter_map(|&(u, v, id)| {
        let point = image.rotation * *points.get(&id)? + image.translation;
        let (x, y) = lens.distortion.distort(point.x / point.z, point.y / point.z);
        (point.z > 0.0).then(|| (point.z, (fx * x + cx - u).hypot(fy * y + cy - v)))
    });
    projected.unzip()
}

/// Near and far depth with a margin, in scene units; `None` for fewer than [`MIN_POINTS`].
pub(crate) fn depth_range(mut depths: Vec<f64>) -> Option<(f64, f64)> {
    if depths.len() < MIN_POINTS {
        return None;
    }
    depths.sort_by(f64::total_cmp);
    Some((0.9 * percentile(&depths, 0.01), 1.1 * percentile(&depths, 0.99)))
}

/// Percentile of sorted values, interpolated linearly between ranks as in NumPy.
fn percentile(sorted: &[f64], fraction: f64) -> f64 {
    let rank = fraction * (sorted.len() - 1) as f64;
    let (low, high) = (sorted[rank as usize], sorted[rank.ceil() as usize]);
    low + (high - low) * rank.fract()
}

/// The note on the reprojection errors (pixels) of all views.
fn reprojection_note(mut errors: Vec<f64>) -> Option<String> {
    errors.sort_by(f64::total_cmp);
    let median = errors.get(errors.len() / 2)?;
    let warning = if *median > 2.0 { ": poses or photos may not belong together" } else { "" };
    Some(format!("median reprojection error of {} tracked points: {median:.2} px{warning}", errors.len()))
}

/// The intrinsics and distortion of one of the model's cameras, and the size of its photos in
/// pixels.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Lens {
    pub(crate) intrinsics: Intrinsics,
    pub(crate) distortion: Distortion,
    pub(crate) size: Size,
}

/// A registered photo; its pose is `cam_from_world`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Registered {
    pub(crate) name: String,
    pub(crate) camera: u32,
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
    /// Keypoints with a 3D point: position in the distorted photo (pixels), id of the point.
    pub(crate) tracked: Vec<(f64, f64, u64)>,
}

/// A sparse model.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Model {
    pub(crate) lenses: HashMap<u32, Lens>,
    pub(crate) images: Vec<Registered>,
    pub(crate) points: HashMap<u64, DVec3>,
}

/// Adds the contents of one file, given its path and bytes, to a model.
type Parse = fn(&Path, &[u8], &mut Model) -> Result<(), SceneError>;

/// An encoding of a model, binary or text.
pub(crate) struct ModelFormat {
    /// File extension.
    pub(crate) extension: &'static str,
    pub(crate) cameras: Parse,
    pub(crate) images: Parse,
    pub(crate) points: Parse,
}

impl ModelFormat {
    pub(crate) fn file(&self, folder: &Path, name: &str) -> PathBuf {
        folder.join(format!("{name}.{}", self.extension))
    }

    pub(crate) fn is_in(&self, folder: &Path) -> bool {
        ["cameras", "images"].iter().all(|name| self.file(folder, name).is_file())
    }

    pub(crate) fn read(&self, folder: &Path) -> Result<Model, SceneError> {
        let mut model = Model::default();
        for (name, parse) in [("cameras", self.cameras), ("images", self.images), ("points3D", self.points)] {
            let path = self.file(folder, name);
            if name != "points3D" || path.is_file() {
                parse(&path, &scene_file::read(&path)?, &mut model)?;
            }
        }
        Ok(model)
    }
}

/// Camera models and their numbers of parameters, indexed by the model number in binary files.
pub(crate) const MODELS: [(&str, usize); 12] = [
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
pub(crate) fn lens(path: &Path, model: &str, size: Size, parameters: &[f64]) -> Result<Lens, SceneError> {
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
pub(crate) fn rotation([w, x, y, z]: [f64; 4]) -> DMat3 {
    let length = (w * w + x * x + y * y + z * z).sqrt();
    let unit = DQuat::from_xyzw(x / length, y / length, z / length, w / length);
    // `DMat3::from_quat` panics on other lengths in some builds; NaN becomes an error later.
    if length > 0.0 && unit.is_finite() { DMat3::from_quat(unit) } else { DMat3::NAN }
}
