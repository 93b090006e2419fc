//! Photos as files in the scene folder.

use std::fs;
use std::path::{Path, PathBuf};

use super::file::load_photo;
use super::source::{Found, ListedPhoto, Photo, PhotoList, PhotoSource};
use crate::SceneError;
use crate::pose_file::{below_root, safe_name};
use liveview::image::{Header, ImageRgb, read_header};
use liveview_files::has_extension;

/// Levels of nested folders in which photos are searched.
const MAX_DEPTH: usize = 4;

/// Folders of reduced copies of the photos in `images`, the largest first.
const REDUCED: [&str; 3] = ["images_2", "images_4", "images_8"];

/// PNG and JPEG files in a folder, named by their path relative to it. A photo that a pose file
/// lists is looked for by its path; by shorter and shorter ends of it, since folders are moved; with
/// another extension; and, where there is no folder `images`, in `images_2`, `images_4` or
/// `images_8`. Always inside the folder: a path with `..` is refused.
#[derive(Debug, Clone)]
pub struct PhotoFolder {
    root: PathBuf,
}

impl PhotoFolder {
    /// The photos in this folder and its subfolders.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The photo of that name, or with another extension, or in a folder of reduced copies.
    fn existing(&self, name: &str) -> Option<String> {
        let rest = name.strip_prefix("images/").filter(|_| !self.root.join("images").is_dir());
        let reduced = rest.map(|rest| REDUCED.map(|folder| format!("{folder}/{rest}")));
        let folders = std::iter::once(name.to_owned()).chain(reduced.into_iter().flatten());
        let mut names = folders.flat_map(|name| [vec![name.clone()], other_extensions(&name)].concat());
        names.find(|name| self.root.join(name).is_file())
    }
}

impl PhotoSource for PhotoFolder {
    fn find(&self, listed: &ListedPhoto<'_>) -> Result<Found, SceneError> {
        let name = safe_name(listed.listed_in, below_root(listed.name))?;
        // Poses may have been estimated in another folder: then the end of the path names the photo.
        let ends = name.rmatch_indices('/').take(MAX_DEPTH + 1).map(|(at, _)| &name[at + 1..]);
        let ends: Vec<&str> = ends.collect();
        let mut names = std::iter::once(&*name).chain(ends.into_iter().rev());
        let Some(name) = names.find_map(|name| self.existing(name)) else {
            let (path, listed_in) = (self.root.join(listed.name), listed.listed_in.to_owned());
            return Err(SceneError::MissingImage { path, listed_in });
        };
        let path = self.root.join(&name);
        let Header { size, oriented, alpha, .. } = read_header(&path)?;
        let orientation =
            oriented.then_some("EXIF orientation ignored, poses are assumed to belong to the pixels as stored");
        let alpha = alpha.then_some("alpha channel dropped, colours used as stored");
        let ignored = orientation.into_iter().chain(alpha).collect();
        Ok(Found::Photo(Photo { name, path, size, ignored }))
    }

    fn list(&self, folders: &[&str]) -> Result<Option<PhotoList>, SceneError> {
        let Some(&folder) = folders.iter().find(|folder| self.root.join(folder).is_dir()) else { return Ok(None) };
        let mut names = Vec::new();
        collect(&self.root.join(folder), "", MAX_DEPTH, &mut names)?;
        names.sort();
        Ok(Some(PhotoList { folder: Some(folder.to_owned()), names }))
    }

    fn load(&self, name: &str) -> Result<ImageRgb, SceneError> {
        load_photo(&self.root.join(name))
    }
}

/// `name` with an extension added, then with its extension replaced.
fn other_extensions(name: &str) -> Vec<String> {
    let stem = match name.rsplit_once('.') {
        Some((stem, extension)) if !extension.contains('/') => stem,
        _ => name,
    };
    let endings = ["png", "jpg", "jpeg", "PNG", "JPG", "JPEG"];
    [name, stem].iter().flat_map(|base| endings.map(|ending| format!("{base}.{ending}"))).collect()
}

/// Adds the names of the photos in `folder` and its subfolders, each preceded by `prefix`.
fn collect(folder: &Path, prefix: &str, depth: usize, names: &mut Vec<String>) -> Result<(), SceneError> {
    let failed = |source| SceneError::Read { path: folder.to_owned(), source };
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        // No scene file can list a name that is not UTF-8.
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else { continue };
        if name.starts_with('.') {
            continue;
        }
        if path.is_dir() {
            if depth > 0 {
                collect(&path, &format!("{prefix}{name}/"), depth - 1, names)?;
            }
        } else if has_extension(&path, &["png", "jpg", "jpeg"]) {
            names.push(format!("{prefix}{name}"));
        }
    }
    Ok(())
}
