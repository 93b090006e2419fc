//! Output files: one file, or a folder of them; checked before any work.

use std::collections::HashSet;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use liveview::fs::atomic::{self, AtomicFile};
use liveview::{Scene, Shot};

/// One file, or a folder of them.
pub(crate) enum Place {
    File(PathBuf),
    Folder(PathBuf),
}

/// A suffix that is added to a name, and the ending if it differs from the name's own.
pub(crate) type Variant = (&'static str, Option<&'static str>);

impl Place {
    /// A folder if there is one of that name, or the name has no extension; else a file, with one of these endings.
    pub(crate) fn new(option: &str, path: &Path, endings: &[&str]) -> Result<Self> {
        if path.is_dir() || path.as_os_str().to_string_lossy().ends_with('/') || path.extension().is_none() {
            return Ok(Self::Folder(path.to_owned()));
        }
        if !has_ending(path, endings) {
            bail!("{option} {}: expected a name that ends in .{}, or a folder", path.display(), endings.join(", ."));
        }
        Ok(Self::File(path.to_owned()))
    }

    /// The file of a shot.
    pub(crate) fn file(&self, shot: &Shot, suffix: &str, ending: Option<&str>) -> PathBuf {
        let (folder, mut name, own) = match self {
            Self::File(path) => (path.parent(), path.file_stem().unwrap_or_default().to_owned(), path.extension()),
            Self::Folder(path) => (Some(path.as_path()), stem(&shot.name).into(), None),
        };
        // Not formatted as text: a name need not be UTF-8.
        name.push(suffix);
        name.push(".");
        name.push(ending.map(OsStr::new).or(own).unwrap_or(OsStr::new("png")));
        folder.unwrap_or(Path::new("")).join(name)
    }

    /// The files of a shot, one per variant.
    pub(crate) fn files<const N: usize>(&self, shot: &Shot, variants: [Variant; N]) -> [PathBuf; N] {
        variants.map(|(suffix, ending)| self.file(shot, suffix, ending))
    }
}

/// The files of all photos of a scene, which nothing may overwrite.
pub(crate) fn photo_files(scene: &Scene) -> HashSet<PathBuf> {
    scene.views.iter().filter_map(|view| view.image_path().canonicalize().ok()).collect()
}

/// Refuses a file that cannot be written or is one of the `photos`; creates missing folders.
pub(crate) fn claim(option: &str, file: &Path, photos: &HashSet<PathBuf>) -> Result<()> {
    let folder = file.parent().unwrap_or(Path::new(""));
    let refused = |why: String| anyhow!("{option} {}: cannot be written: {why}", file.display());
    if folder.exists() && !folder.is_dir() {
        return Err(refused(format!("{} is a file; expected a folder", folder.display())));
    }
    if file.is_dir() {
        return Err(refused("it is a folder; expected a file, or nothing yet".to_owned()));
    }
    std::fs::create_dir_all(folder)
        .and_then(|()| AtomicFile::create(file).map(drop))
        .map_err(|error| refused(error.to_string()))?;
    if file.canonicalize().is_ok_and(|taken| photos.contains(&taken)) {
        bail!("{option} {}: would overwrite a photo of the scene; expected another place", file.display());
    }
    Ok(())
}

/// Refuses, before any work, a name that is not of a PNG, or a file that cannot be written.
pub(crate) fn claim_png(option: &str, file: &Path, scene: &Scene) -> Result<()> {
    match Place::new(option, file, &["png"])? {
        Place::File(file) => claim(option, &file, &photo_files(scene)),
        Place::Folder(path) => bail!("{option} {}: expected a name that ends in .png", path.display()),
    }
}

/// A view's name as a file name without extension.
pub(crate) fn stem(name: &str) -> String {
    Path::new(&name.replace('/', "_")).with_extension("").to_string_lossy().into_owned()
}

pub(crate) fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|found| endings.iter().any(|ending| found.eq_ignore_ascii_case(ending)))
}

/// Writes a file whole or not at all.
pub(crate) fn write_whole(path: &Path, contents: &[u8]) -> Result<()> {
    atomic::write(path, contents).map_err(|error| anyhow!("{}: cannot be written: {error}", path.display()))
}
