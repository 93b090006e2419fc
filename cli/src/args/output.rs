//! Paths of output files.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use liveview_files::atomic;
pub(crate) use liveview_files::has_extension;
use liveview_synthesizer::Shot;

/// An output path: one file, or a folder of files.
#[derive(Debug)]
pub(crate) enum OutputPath {
    /// One file.
    File(PathBuf),
    /// A folder with a file for each shot.
    Folder(PathBuf),
}

/// A suffix to the file name, and the extension if it differs from the path's own.
pub(crate) type Variant = (&'static str, Option<&'static str>);

impl OutputPath {
    /// A folder, if one exists there or the path has no extension; else a file, which must have one
    /// of these extensions.
    pub(crate) fn new(option: &str, path: &Path, extensions: &[&str]) -> Result<Self> {
        refuse_stdout(option, path)?;
        if path.is_dir() || path.as_os_str().to_string_lossy().ends_with('/') || path.extension().is_none() {
            return Ok(Self::Folder(path.to_owned()));
        }
        if !has_extension(path, extensions) {
            let extensions = extensions.join(", .");
            bail!("{option} {}: expected a name that ends in .{extensions}, or a folder", path.display());
        }
        Ok(Self::File(path.to_owned()))
    }

    /// The file of a picture of this name.
    pub(crate) fn file(&self, picture: &str, suffix: &str, extension: Option<&str>) -> PathBuf {
        let (folder, mut name, own) = match self {
            Self::File(path) => (path.parent(), path.file_stem().unwrap_or_default().to_owned(), path.extension()),
            Self::Folder(path) => (Some(path.as_path()), stem(picture).into(), None),
        };
        // Not `format!`: a name need not be UTF-8.
        name.push(suffix);
        name.push(".");
        name.push(extension.map(OsStr::new).or(own).unwrap_or(OsStr::new("png")));
        folder.unwrap_or(Path::new("")).join(name)
    }

    /// The files of a shot, one per variant.
    pub(crate) fn files<const N: usize>(&self, shot: &Shot, variants: [Variant; N]) -> [PathBuf; N] {
        variants.map(|(suffix, extension)| self.file(&shot.name, suffix, extension))
    }
}

/// Refuses `-`, which often means standard output.
pub(crate) fn refuse_stdout(option: &str, path: &Path) -> Result<()> {
    if path == Path::new("-") {
        bail!("{option} -: standard output is not supported; expected a file or a folder (./- for one of that name)");
    }
    Ok(())
}

/// Checks that a path is a file with the extension .png.
pub(crate) fn expect_png(option: &str, file: &Path) -> Result<()> {
    match OutputPath::new(option, file, &["png"])? {
        OutputPath::File(_) => Ok(()),
        OutputPath::Folder(path) => bail!("{option} {}: expected a name that ends in .png", path.display()),
    }
}

/// A view's name as a file name without extension.
pub(crate) fn stem(name: &str) -> String {
    Path::new(&name.replace('/', "_")).with_extension("").to_string_lossy().into_owned()
}

/// Writes a file atomically.
pub(crate) fn write_atomically(path: &Path, contents: &[u8]) -> Result<()> {
    atomic::write(path, contents).map_err(|error| anyhow!("{}: cannot be written: {error}", path.display()))
}
