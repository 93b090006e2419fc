//! LLFF: `poses_bounds.npy` and a folder of photos, matched by order: row i belongs to the i-th
//! name in byte order.
//!
//! The photos are usually downscaled copies; intrinsics are scaled to their actual size. Depth
//! ranges are the stored bounds.

use std::path::Path;

use super::poses_bounds::{self, PoseBounds};
use crate::scene::declared::{DeclaredSize, DeclaredView, DeclaredViews};
use crate::scene::error::SceneError;
use crate::scene::options::SceneOptions;
use crate::scene::photos::lookup::{PhotoLookup, list_photos};
use crate::scene::photos::source::{PhotoList, PhotoSource};
use crate::scene::pose_file::read;
use crate::scene::undistort::Distortion;

/// Photo folders, in order of precedence.
const FOLDERS: [&str; 4] = ["images_8", "images_4", "images_2", "images"];

pub(in crate::scene) fn open(
    root: &Path,
    photos: &dyn PhotoSource,
    options: &SceneOptions,
) -> Result<DeclaredViews, SceneError> {
    let path = root.join("poses_bounds.npy");
    let rows = poses_bounds::parse(&path, &read(&path)?)?;
    let list = list_photos(root, photos, options.images.as_deref(), &FOLDERS)?;
    if list.names.len() != rows.len() {
        let folder = list.folder.map_or_else(|| root.to_owned(), |folder| root.join(folder));
        return Err(SceneError::CountMismatch { path, rows: rows.len(), folder, images: list.names.len() });
    }
    views(&path, rows, &list, photos)
}

/// Views of the listed photos, one for each row of the file.
pub(in crate::scene) fn views(
    path: &Path,
    rows: Vec<PoseBounds>,
    list: &PhotoList,
    photos: &dyn PhotoSource,
) -> Result<DeclaredViews, SceneError> {
    let mut lookup = PhotoLookup::new(photos, path);
    let mut views = Vec::with_capacity(rows.len());
    for (row, name) in rows.into_iter().zip(&list.names) {
        let Some(photo) = lookup.find(&list.with_folder(name))? else { continue };
        views.push(DeclaredView {
            photo,
            intrinsics: row.intrinsics,
            size: DeclaredSize::Scaled(row.size),
            rotation: row.rotation,
            translation: row.translation,
            distortion: Distortion::default(),
            depth_range: Some((row.near, row.far)),
        });
    }
    let mut notes = lookup.into_notes(&views)?;
    notes.extend(list.folder.iter().map(|folder| format!("photos are read from {folder}")));
    Ok(DeclaredViews { cameras: path.to_owned(), views, notes })
}
