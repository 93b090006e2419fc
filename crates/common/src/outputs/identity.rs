//! What a path is, whatever its spelling.

use std::ffi::OsString;
use std::io;
use std::path::{Component, Path, PathBuf};

/// A file or folder that exists: the same for all of its names.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct Identity(#[cfg(unix)] (u64, u64), #[cfg(not(unix))] PathBuf);

impl Identity {
    #[cfg(unix)]
    pub(super) fn of(path: &Path) -> io::Result<Self> {
        use std::os::unix::fs::MetadataExt;
        let about = path.metadata()?;
        Ok(Self((about.dev(), about.ino())))
    }

    #[cfg(not(unix))]
    pub(super) fn of(path: &Path) -> io::Result<Self> {
        path.canonicalize().map(Self)
    }
}

/// A place for a file: a folder that exists, and the names below it.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct Spot(Option<Identity>, Vec<OsString>);

impl Spot {
    /// Of a path that is [`resolved`].
    pub(super) fn of(real: &Path) -> Self {
        let (mut folder, mut names) = (real, Vec::new());
        while let (Some(name), Some(parent)) = (folder.file_name(), folder.parent()) {
            names.push(name.to_owned());
            if let Ok(identity) = Identity::of(parent) {
                return Self(Some(identity), names);
            }
            folder = parent;
        }
        Self(None, names)
    }
}

/// The path without links and `..`; of what does not exist, `..` goes by name.
pub(super) fn resolved(path: &Path) -> io::Result<PathBuf> {
    if let Ok(real) = path.canonicalize() {
        return Ok(real);
    }
    let mut real = PathBuf::new();
    for part in std::path::absolute(path)?.components() {
        if part == Component::ParentDir {
            real.pop();
        } else {
            real.push(part);
        }
        real = real.canonicalize().unwrap_or(real);
    }
    Ok(real)
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn a_place_is_the_same_by_all_names() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        std::fs::create_dir_all(at("a/b")).unwrap();
        symlink(at("a/b"), at("link")).unwrap();
        let spot = |name: &str| Spot::of(&resolved(&at(name)).unwrap());
        for same in
            ["a/./b/new/c.png", "link/new/c.png", "link/../b/new/c.png", "link/x/../new/c.png", "none/../a/b/new/c.png"]
        {
            assert_eq!(spot(same), spot("a/b/new/c.png"), "{same}");
        }
        assert_ne!(spot("a/new/c.png"), spot("a/b/new/c.png"));
        assert_ne!(spot("a/b/c.png"), spot("a/b/new/c.png"));
    }
}
