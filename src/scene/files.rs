//! The files of a scene folder: safe paths, listings, and photos' sizes.

use std::fs;
use std::path::{Component, Path};

use super::SceneError;
use crate::fs::bounded;
use crate::image;

/// A photo that exists, with the size its header gives.
pub(super) struct Photo {
    /// Path relative to the scene's root, with `/`, as listed.
    pub(super) name: String,
    pub(super) width: usize,
    pub(super) height: usize,
}

/// Folders nested deeper than this are not searched for photos.
const MAX_DEPTH: usize = 4;

const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Finds the photo of a name.
pub(super) type FindPhoto<'a> = &'a dyn Fn(&str) -> Result<Photo, SceneError>;

/// A whole file.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, SceneError> {
    read_up_to(bounded::MAX_BYTES, path)
}

/// A whole JSON file.
pub(super) fn read_json(path: &Path) -> Result<Vec<u8>, SceneError> {
    read_up_to(bounded::MAX_JSON_BYTES, path)
}

fn read_up_to(limit: u64, path: &Path) -> Result<Vec<u8>, SceneError> {
    bounded::read(path, limit).map_err(|source| SceneError::Read { path: path.to_owned(), source })
}

/// The text of a file; bytes that are not UTF-8 are an error.
pub(super) fn text<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a str, SceneError> {
    std::str::from_utf8(bytes)
        .map_err(|error| SceneError::malformed(path, format!("byte {} is not text", error.valid_up_to()), "UTF-8"))
}

/// `name` made clean (no `./`), or refused if it leads out of the scene folder. Links are followed: a file of the scene cannot
/// make them, only its owner.
pub(super) fn safe_name(listed_in: &Path, name: &str) -> Result<String, SceneError> {
    let refuse = || SceneError::UnsafePath { path: listed_in.to_owned(), image: name.to_owned() };
    let mut parts = Vec::new();
    for component in Path::new(name).components() {
        match component {
            Component::Normal(part) => parts.push(part.to_str().ok_or_else(refuse)?),
            Component::CurDir => {}
            Component::ParentDir | Component::RootDir | Component::Prefix(_) => return Err(refuse()),
        }
    }
    if parts.is_empty() { Err(refuse()) } else { Ok(parts.join("/")) }
}

/// The photo `name` below `root`. If there is none of that name, the same name with another image extension (`try_extensions`) will do.
pub(super) fn photo(root: &Path, listed_in: &Path, name: &str, try_extensions: bool) -> Result<Photo, SceneError> {
    let name = safe_name(listed_in, name)?;
    let found = if root.join(&name).is_file() {
        Some(name.clone())
    } else if try_extensions {
        candidates(&name).into_iter().find(|other| root.join(other).is_file())
    } else {
        None
    };
    let Some(name) = found else {
        return Err(SceneError::MissingImage { path: root.join(&name), listed_in: listed_in.to_owned() });
    };
    let (width, height) = image::read_size(&root.join(&name))?;
    Ok(Photo { name, width, height })
}

/// `name` with an extension added, then with its extension replaced.
fn candidates(name: &str) -> Vec<String> {
    let stem = match name.rsplit_once('.') {
        Some((stem, extension)) if !extension.contains('/') => stem,
        _ => name,
    };
    let endings = ["png", "jpg", "jpeg", "PNG", "JPG", "JPEG"];
    [name, stem].iter().flat_map(|base| endings.map(|ending| format!("{base}.{ending}"))).collect()
}

/// Names of the photos below `folder`, relative to it, sorted as text.
pub(super) fn list_photos(folder: &Path) -> Result<Vec<String>, SceneError> {
    let mut names = Vec::new();
    collect(folder, "", MAX_DEPTH, &mut names)?;
    names.sort();
    Ok(names)
}

fn collect(folder: &Path, prefix: &str, depth: usize, names: &mut Vec<String>) -> Result<(), SceneError> {
    let failed = |source| SceneError::Read { path: folder.to_owned(), source };
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        // A name that is not UTF-8 cannot be listed in any scene file.
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else { continue };
        if name.starts_with('.') {
            continue;
        }
        if path.is_dir() {
            if depth > 0 {
                collect(&path, &format!("{prefix}{name}/"), depth - 1, names)?;
            }
        } else if is_photo(name) {
            names.push(format!("{prefix}{name}"));
        }
    }
    Ok(())
}

fn is_photo(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|found| EXTENSIONS.iter().any(|e| found.eq_ignore_ascii_case(e)))
}

/// The first of `folders` that exists below `root`, or the one asked for.
pub(super) fn images_folder(root: &Path, asked: Option<&str>, folders: &[&str]) -> Result<String, SceneError> {
    let found = match asked {
        Some(name) => Some(safe_name(root, name)?).filter(|name| root.join(name).is_dir()),
        None => folders.iter().find(|name| root.join(name).is_dir()).map(|name| (*name).to_owned()),
    };
    let wanted = asked.map_or_else(|| folders.join(", "), str::to_owned);
    found.ok_or_else(|| SceneError::malformed(root, "no folder of photos", format!("one of: {wanted}")))
}

/// Names in a note: all of them, or the first few and how many more.
pub(super) fn some_of(names: &[String]) -> String {
    const SHOWN: usize = 12;
    let shown = names.iter().take(SHOWN).map(String::as_str).collect::<Vec<_>>().join(", ");
    match names.len().checked_sub(SHOWN) {
        Some(more) if more > 0 => format!("{shown} and {more} more"),
        _ => shown,
    }
}
