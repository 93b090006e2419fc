//! Output files: one file, or a folder of them.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use liveview::Shot;
use liveview::fs::atomic;

/// One file, or a folder of them.
#[derive(Debug)]
pub enum Place {
    /// One file.
    File(PathBuf),
    /// A folder, in which each shot has its own file.
    Folder(PathBuf),
}

/// A suffix that is added to a name, and the ending if it differs from the name's own.
pub type Variant = (&'static str, Option<&'static str>);

impl Place {
    /// A folder if there is one of that name, or the name has no extension; else a file, with one of these endings.
    pub fn new(option: &str, path: &Path, endings: &[&str]) -> Result<Self> {
        refuse_stdout(option, path)?;
        if path.is_dir() || path.as_os_str().to_string_lossy().ends_with('/') || path.extension().is_none() {
            return Ok(Self::Folder(path.to_owned()));
        }
        if !has_ending(path, endings) {
            bail!("{option} {}: expected a name that ends in .{}, or a folder", path.display(), endings.join(", ."));
        }
        Ok(Self::File(path.to_owned()))
    }

    /// The file of a shot.
    pub fn file(&self, shot: &Shot, suffix: &str, ending: Option<&str>) -> PathBuf {
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
    pub fn files<const N: usize>(&self, shot: &Shot, variants: [Variant; N]) -> [PathBuf; N] {
        variants.map(|(suffix, ending)| self.file(shot, suffix, ending))
    }
}

/// Refuses `-`, which would be taken for standard output.
pub fn refuse_stdout(option: &str, path: &Path) -> Result<()> {
    if path == Path::new("-") {
        bail!("{option} -: nothing goes to standard output; expected a file or a folder (./- is one of that name)");
    }
    Ok(())
}

/// Refuses a name that is not of a PNG.
pub fn expect_png(option: &str, file: &Path) -> Result<()> {
    match Place::new(option, file, &["png"])? {
        Place::File(_) => Ok(()),
        Place::Folder(path) => bail!("{option} {}: expected a name that ends in .png", path.display()),
    }
}

/// A view's name as a file name without extension.
pub fn stem(name: &str) -> String {
    Path::new(&name.replace('/', "_")).with_extension("").to_string_lossy().into_owned()
}

/// Whether a path has one of these extensions, in upper or lower case.
pub fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|found| endings.iter().any(|ending| found.eq_ignore_ascii_case(ending)))
}

/// Writes a file whole or not at all.
pub fn write_whole(path: &Path, contents: &[u8]) -> Result<()> {
    atomic::write(path, contents).map_err(|error| anyhow!("{}: cannot be written: {error}", path.display()))
}
