//! LLFF: `poses_bounds.npy` beside a folder of photos, matched by order: row i belongs to the i-th name sorted as text.
//!
//! The photos are usually reduced copies; intrinsics follow their actual size. Depth ranges are the stored bounds.

use std::path::Path;

use super::poses_bounds::{self, PoseBounds};
use crate::scene::draft::{Draft, Drafts, Size};
use crate::scene::files::{FindPhoto, images_folder, list_photos, photo, read};
use crate::scene::undistort::Distortion;
use crate::scene::{SceneError, SceneOptions};

/// Folders of photos, in the order they are tried.
const FOLDERS: [&str; 4] = ["images_8", "images_4", "images_2", "images"];

pub(in crate::scene) fn open(root: &Path, options: &SceneOptions) -> Result<Drafts, SceneError> {
    let path = root.join("poses_bounds.npy");
    let rows = poses_bounds::parse(&path, &read(&path)?)?;
    let folder = images_folder(root, options.images.as_deref(), &FOLDERS)?;
    let names = list_photos(&root.join(&folder))?;
    if names.len() != rows.len() {
        let folder = root.join(folder);
        return Err(SceneError::CountMismatch { path, rows: rows.len(), folder, images: names.len() });
    }
    drafts(&path, rows, &folder, &names, &|name| photo(root, &path, name, false))
}

/// One row of the file for each of the `names` in `folder`.
pub(in crate::scene) fn drafts(
    path: &Path,
    rows: Vec<PoseBounds>,
    folder: &str,
    names: &[String],
    find: FindPhoto<'_>,
) -> Result<Drafts, SceneError> {
    let mut drafts = Vec::with_capacity(rows.len());
    for (row, name) in rows.into_iter().zip(names) {
        drafts.push(Draft {
            photo: find(&format!("{folder}/{name}"))?,
            intrinsics: row.intrinsics,
            size: Size::Scaled(row.width, row.height),
            rotation: row.rotation,
            translation: row.translation,
            distortion: Distortion::default(),
            depth_range: Some((row.near, row.far)),
        });
    }
    Ok(Drafts { cameras: path.to_owned(), drafts, notes: vec![format!("photos are those of {folder}")] })
}
