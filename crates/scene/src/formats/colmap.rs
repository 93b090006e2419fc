//! COLMAP sparse models: `cameras`, `images` and `points3D`, binary or text, in a numbered folder of `sparse`, in
//! `sparse`, or in the folder itself; of several the one with most photos.
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
use std::fs;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use crate::photos::{PhotoLookup, list_photos};
use crate::scene_file::{self, abbreviated, safe_name};
use crate::undistort::{DIVISIONS, FISHEYES, PINHOLES};
use crate::{DeclaredView, DeclaredViews, Distortion, PhotoList, PhotoSource, SceneError, SceneOptions};
use liveview::geometry::{Camera, Intrinsics, Size};

pub(crate) mod binary;
pub(crate) mod text;

/// Tracked points that a view needs for a depth range.
const MIN_POINTS: usize = 8;

/// Where a sparse model, or several in numbered folders, may lie, in order of precedence.
pub(super) const MODEL_FOLDERS: [&str; 4] = ["sparse", "", "colmap/sparse", "distorted/sparse"];

/// The folders of the sparse models, and their formats.
fn model_folders(root: &Path) -> Vec<(PathBuf, ModelFormat)> {
    let models_in = |folder: &str| -> Vec<(PathBuf, ModelFormat)> {
        let numbered = fs::read_dir(root.join(folder)).into_iter().flatten().flatten().map(|entry| entry.path());
        let is_number =
            |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().parse::<u32>().is_ok());
        let mut folders: Vec<PathBuf> = numbered.filter(is_number).collect();
        folders.sort();
        folders.push(root.join(folder));
        let model = |folder: PathBuf| {
            let format = [binary::FORMAT, text::FORMAT].into_iter().find(|format| format.is_in(&folder))?;
            Some((folder, format))
        };
        folders.into_iter().filter_map(model).collect()
    };
    MODEL_FOLDERS.into_iter().map(models_in).find(|models| !models.is_empty()).unwrap_or_default()
}

/// The folder, if it holds a sparse model.
pub(super) fn model_in(root: &Path) -> Option<PathBuf> {
    (!model_folders(root).is_empty()).then(|| root.to_owned())
}

/// The sparse model with most photos, and its file of these.
pub(crate) fn read(root: &Path) -> Result<(Model, PathBuf), SceneError> {
    let folders = model_folders(root);
    let count = folders.len();
    let (mut best, mut failed) = (None, None);
    for (folder, format) in folders {
        match format.read(&folder) {
            Ok(model) if best.as_ref().is_none_or(|(best, _): &(Model, _)| best.images.len() < model.images.len()) => {
                best = Some((model, format.file(&folder, "images")));
            }
            Ok(_) => {}
            Err(error) => failed = failed.or(Some(error)),
        }
    }
    let none = || SceneError::malformed(root, "no COLMAP model", "sparse/0 with cameras and images, .bin or .txt");
    let (mut model, images) = best.ok_or_else(|| failed.unwrap_or_else(none))?;
    if count > 1 {
        let folder =
            images.parent().and_then(|folder| folder.strip_prefix(root).ok()).unwrap_or(Path::new("")).display();
        model.notes.push(format!("{count} COLMAP models: {folder} has most photos and is read"));
    }
    Ok((model, images))
}

pub(super) fn open(options: &SceneOptions, lookup: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
    let (root, photos) = (lookup.listed_in, lookup.photos);
    let (mut model, listed_in) = read(root)?;
    let list = list_photos(root, photos, options.images.as_deref())?;
    rename_in_order(&mut model, &list, photos)?;
    let mut found = views(&model, &list, PhotoLookup::new(photos, &listed_in))?;
    let registered: HashSet<&str> = found.views.iter().map(|view| view.photo.name.as_str()).collect();
    let is_unregistered = |name: &&String| !registered.contains(list.with_folder(name).as_str());
    let names: Vec<String> = list.names.iter().filter(is_unregistered).cloned().collect();
    if !names.is_empty() {
        let names = (names.len(), abbreviated(&names));
        found.notes.push(format!("{} photos were not registered by COLMAP, skipped: {}", names.0, names.1));
    }
    Ok(found)
}

/// LLFF names reduced copies by their number: where no name of the model is in a folder, its photos are taken in the
/// order of the names of those in `images`, or of the model's.
fn rename_in_order(model: &mut Model, list: &PhotoList, photos: &dyn PhotoSource) -> Result<(), SceneError> {
    let stem = |name: &str| Path::new(name).with_extension("");
    let stems: HashSet<PathBuf> = list.names.iter().map(|name| stem(name)).collect();
    let is_reduced = list.folder.as_deref().is_some_and(|folder| folder.starts_with("images_"));
    if !is_reduced || model.images.iter().any(|image| stems.contains(&stem(&image.name))) {
        return Ok(());
    }
    let mut names: Vec<String> = photos.list(&["images"])?.map(|list| list.names).unwrap_or_default();
    if names.len() != list.names.len() {
        names = model.images.iter().map(|image| image.name.clone()).collect();
        names.sort();
    }
    if names.len() == list.names.len() {
        let renamed: HashMap<&String, &String> = names.iter().zip(&list.names).collect();
        model.images.iter_mut().for_each(|image| {
            if let Some(name) = renamed.get(&image.name) {
                image.name.clone_from(name);
            }
        });
        model.notes.push("the photos' names are not the model's: taken in the order of the names".to_owned());
    }
    Ok(())
}

/// Views of the listed photos.
pub(crate) fn views(model: &Model, list: &PhotoList, mut lookup: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
    let listed_in = lookup.listed_in;
    let elsewhere = list.folder.as_deref().filter(|&folder| !["images", ""].contains(&folder));
    let mut errors = Vec::new();
    for image in &model.images {
        let Some(lens) = model.lenses.get(&image.camera) else {
            let what = format!("image {} has camera {}, which is not listed", image.name, image.camera);
            return Err(SceneError::malformed(listed_in, what, "the number of a camera of this model"));
        };
        let name = safe_name(listed_in, &image.name)?;
        let Some(photo) = lookup.find(&list.with_folder(&name))? else { continue };
        let Intrinsics { fx, fy, cx, cy, .. } = lens.intrinsics;
        // Of the tracked points in front of the camera, their depths and reprojection errors.
        let projected = image.tracked.iter().filter_map(|&(u, v, id)| {
            let point = image.rotation * *model.points.get(&id)? + image.translation;
            let (x, y) = lens.distortion.distort(point.x / point.z, point.y / point.z);
            (point.z > 0.0).then(|| (point.z, (fx * x + cx - u).hypot(fy * y + cy - v)))
        });
        let (depths, of_view): (Vec<f64>, Vec<f64>) = projected.unzip();
        errors.extend(of_view);
        let view = DeclaredView::new(photo, (lens.intrinsics, lens.size), (image.rotation, image.translation));
        lookup.views.push(DeclaredView { distortion: lens.distortion, depth_range: depth_range(depths), ..view });
    }
    let mut found = lookup.finish()?;
    found.notes.extend(model.notes.iter().cloned());
    found.notes.extend(elsewhere.map(|folder| format!("photos are read from {folder}")));
    errors.sort_by(f64::total_cmp);
    found.reprojection_error = errors.get(errors.len() / 2).copied();
    if let Some(median) = found.reprojection_error.filter(|median| *median > 2.0) {
        found.notes.push(format!("median reprojection error {median:.2} px: poses or photos may not belong together"));
    }
    if model.points.is_empty() {
        found.notes.push("no points3D, which would give the depth range".to_owned());
    }
    Ok(found)
}

/// Near and far depth with a margin, in scene units; `None` for fewer than [`MIN_POINTS`].
fn depth_range(mut depths: Vec<f64>) -> Option<(f64, f64)> {
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
    pub(crate) notes: Vec<String>,
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
            if name == "points3D" && !path.is_file() {
                continue;
            }
            match scene_file::read(&path).and_then(|bytes| parse(&path, &bytes, &mut model)) {
                // Only the range of depths needs the points.
                Err(error) if name == "points3D" => {
                    model.points.clear();
                    model.notes.push(format!("its points are not used: {error}"));
                }
                parsed => parsed?,
            }
        }
        Ok(model)
    }
}

/// Camera models and their numbers of parameters, indexed by the model number in binary files.
pub(crate) const MODELS: [(&str, usize); 18] = [
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
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    ("EQUIRECTANGULAR", 2),
];

/// A lens from a camera model's name and parameters; an error for unsupported models.
pub(crate) fn lens(path: &Path, model: &str, size: Size, parameters: &[f64]) -> Result<Lens, SceneError> {
    let (fisheye, division) = (FISHEYES.contains(&model), DIVISIONS.contains(&model));
    if !fisheye && !division && !PINHOLES.contains(&model) {
        let read = [&PINHOLES[..], &FISHEYES, &DIVISIONS].concat().join(", ");
        let hint = format!("run COLMAP's image_undistorter first, or use {read}");
        return Err(SceneError::unsupported(path, format!("camera model {model}"), &hint));
    }
    if !MODELS.contains(&(model, parameters.len())) {
        let what = format!("a {model} camera with {} parameters", parameters.len());
        return Err(SceneError::malformed(path, what, "the camera model's number of parameters"));
    }
    // One focal length or two, the principal point, then the first coefficients of FULL_OPENCV's or of a fisheye.
    let has_one_focal_length = model.starts_with("SIMPLE") || model.starts_with("RADIAL");
    let (focal, rest) = parameters.split_at(if has_one_focal_length { 1 } else { 2 });
    let (centre, given) = rest.split_at(2);
    let intrinsics = Intrinsics { fx: focal[0], fy: focal[focal.len() - 1], cx: centre[0], cy: centre[1], skew: 0.0 };
    let distortion = Distortion { division, ..Distortion::from_opencv(given, fisheye) };
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
