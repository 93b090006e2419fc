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

pub(in crate::scene) mod binary;
pub(in crate::scene) mod model;
pub(in crate::scene) mod text;
mod tracked_points;

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use glam::DVec3;
use model::{Model, ModelFormat};
pub(super) use tracked_points::depth_range;
use tracked_points::{depths_and_errors, reprojection_note};

use crate::geometry::Size;
use crate::scene::declared::{DeclaredSize, DeclaredView, DeclaredViews};
use crate::scene::error::SceneError;
use crate::scene::options::SceneOptions;
use crate::scene::photos::lookup::{PhotoLookup, list_photos};
use crate::scene::photos::source::{PhotoList, PhotoSource};
use crate::scene::pose_file::{abbreviated, safe_name};

/// The folder of the sparse model, and its format.
pub(in crate::scene) fn model_folder(root: &Path) -> Option<(PathBuf, ModelFormat)> {
    let folders = ["sparse/0", "sparse", "", "colmap/sparse/0"].map(|folder| root.join(folder));
    folders.into_iter().find_map(|folder| {
        let format = [binary::FORMAT, text::FORMAT].into_iter().find(|format| format.is_in(&folder))?;
        Some((folder, format))
    })
}

pub(in crate::scene) fn open(
    root: &Path,
    photos: &dyn PhotoSource,
    options: &SceneOptions,
) -> Result<DeclaredViews, SceneError> {
    let Some((folder, format)) = model_folder(root) else {
        return Err(SceneError::malformed(root, "no COLMAP model", "sparse/0 with cameras and images, .bin or .txt"));
    };
    let model = format.read(&folder)?;
    let listed_in = format.file(&folder, "images");
    let list = list_photos(root, photos, options.images.as_deref(), &["images", "images_2", "images_4", "images_8"])?;
    let mut found = views(&listed_in, &model, &list, photos)?;
    found.notes.extend(unregistered(&list, &found.views));
    Ok(found)
}

/// Views of the listed photos.
pub(in crate::scene) fn views(
    listed_in: &Path,
    model: &Model,
    list: &PhotoList,
    photos: &dyn PhotoSource,
) -> Result<DeclaredViews, SceneError> {
    // Downscaled copies differ in size from the model's photos, and may differ in extension.
    let downscaled = list.folder.as_deref().filter(|&folder| folder != "images");
    let mut lookup = PhotoLookup::new(photos, listed_in);
    let mut views = Vec::with_capacity(model.images.len());
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
        views.push(DeclaredView {
            photo,
            intrinsics: lens.intrinsics,
            size: match downscaled {
                Some(_) => DeclaredSize::Scaled(Size::new(lens.width, lens.height)),
                None => DeclaredSize::Exactly(Size::new(lens.width, lens.height)),
            },
            rotation: image.rotation,
            translation: image.translation,
            distortion: lens.distortion,
            depth_range: depth_range(depths),
        });
    }
    let mut notes = lookup.into_notes(&views)?;
    notes.extend(downscaled.map(|folder| format!("photos are read from {folder}")));
    notes.extend(reprojection_note(errors));
    if model.points.is_empty() {
        notes.push("no points3D: depth ranges are unknown".to_owned());
    }
    Ok(DeclaredViews { cameras: listed_in.to_owned(), views, notes })
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
