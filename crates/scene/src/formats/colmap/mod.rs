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

pub(super) mod binary;
pub(super) mod model;
pub(super) mod text;

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use glam::DVec3;
use model::{Lens, Model, ModelFormat, Registered};

use crate::photos::lookup::{PhotoLookup, list_photos};
use crate::pose_file::{abbreviated, safe_name};
use crate::{DeclaredView, DeclaredViews, PhotoList, PhotoSource, SceneError, SceneOptions};
use liveview::geometry::Intrinsics;

/// Tracked points that a view needs for a depth range.
const MIN_POINTS: usize = 8;

/// Where a sparse model may lie, in order of precedence.
const MODEL_FOLDERS: [&str; 4] = ["sparse/0", "sparse", "", "colmap/sparse/0"];

/// The folder of the sparse model, and its format.
pub(super) fn model_folder(root: &Path) -> Option<(PathBuf, ModelFormat)> {
    MODEL_FOLDERS.map(|folder| root.join(folder)).into_iter().find_map(|folder| {
        let format = [binary::FORMAT, text::FORMAT].into_iter().find(|format| format.is_in(&folder))?;
        Some((folder, format))
    })
}

/// The folder of a sparse model that lacks files, if there is one.
pub(super) fn incomplete_model(root: &Path) -> Option<&'static str> {
    MODEL_FOLDERS.into_iter().find(|folder| !folder.is_empty() && root.join(folder).is_dir())
}

pub(super) fn open(root: &Path, photos: &dyn PhotoSource, options: &SceneOptions) -> Result<DeclaredViews, SceneError> {
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
pub(super) fn views(model: &Model, list: &PhotoList, mut lookup: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
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
pub(super) struct Seen {
    /// Centre of its camera, in units of the model.
    pub(super) centre: DVec3,
    /// Range of the depths of its points.
    pub(super) range: Option<(f64, f64)>,
}

/// What a model says of its photos, by name.
pub(super) fn seen(model: &Model) -> HashMap<&str, Seen> {
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
pub(super) fn depth_range(mut depths: Vec<f64>) -> Option<(f64, f64)> {
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
