//! Reads pose files, and checks the photo names they hold.

use std::path::{Component, Path};

use super::SceneError;
use liveview_files::bounded;

/// Reads a file.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, SceneError> {
    read_up_to(bounded::MAX_BYTES, path)
}

/// Reads a JSON file.
pub(super) fn read_json(path: &Path) -> Result<Vec<u8>, SceneError> {
    read_up_to(bounded::MAX_JSON_BYTES, path)
}

fn read_up_to(limit: u64, path: &Path) -> Result<Vec<u8>, SceneError> {
    bounded::read(path, limit).map_err(|source| SceneError::Read { path: path.to_owned(), source })
}

/// The UTF-8 text of a file, without a byte order mark.
pub(super) fn text<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a str, SceneError> {
    std::str::from_utf8(bounded::without_byte_order_mark(bytes))
        .map_err(|error| SceneError::malformed(path, format!("byte {} is not text", error.valid_up_to()), "UTF-8"))
}

/// A declared width or height; `None` unless it is a whole number of pixels.
pub(super) fn pixels(value: f64) -> Option<usize> {
    (value.fract() == 0.0 && (1.0..=1e9).contains(&value)).then_some(value as usize)
}

/// `name` without `./`; an error if it points outside the scene folder. Symbolic links are
/// followed, since only the folder's owner can create them, not a scene file.
pub(super) fn safe_name(listed_in: &Path, name: &str) -> Result<String, SceneError> {
    let refuse = || {
        let what = format!("the path \"{name}\" leaves the scene folder");
        SceneError::malformed(listed_in, what, "a relative path without \"..\"")
    };
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

/// A listed path; an absolute one, of Unix or of Windows (`C:/…`), from below the root of its disk.
pub(super) fn below_root(listed: &str) -> &str {
    let drive = listed.get(1..2) == Some(":") && listed.starts_with(|first: char| first.is_ascii_alphabetic());
    let path = if drive { &listed[2..] } else { listed };
    path.trim_start_matches('/')
}

/// The names as a list for a note; of a long list the first few and the number of others.
pub(super) fn abbreviated(names: &[String]) -> String {
    const SHOWN: usize = 12;
    let shown = names.iter().take(SHOWN).map(String::as_str).collect::<Vec<_>>().join(", ");
    match names.len().checked_sub(SHOWN) {
        Some(more) if more > 0 => format!("{shown} and {more} more"),
        _ => shown,
    }
}
