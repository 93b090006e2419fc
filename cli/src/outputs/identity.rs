//! Compares paths by the file they refer to, not by their spelling.

use std::ffi::OsString;
use std::io;
use std::path::{Component, Path, PathBuf};

/// Identity of an existing file or folder: equal for all paths to it.
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

/// Identity of a file that may not exist yet: an existing folder, and the names below it.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct Location(Option<Identity>, Vec<OsString>);

impl Location {
    /// The location of a [`resolved`] path.
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

/// The path without links and `..`; below a folder that does not exist, `..` removes the preceding
/// name.
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
    fn location_is_equal_for_all_paths_to_a_file() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        std::fs::create_dir_all(at("a/b")).unwrap();
        symlink(at("a/b"), at("link")).unwrap();
        let location = |name: &str| Location::of(&resolved(&at(name)).unwrap());
        for same in
            ["a/./b/new/c.png", "link/new/c.png", "link/../b/new/c.png", "link/x/../new/c.png", "none/../a/b/new/c.png"]
        {
            assert_eq!(location(same), location("a/b/new/c.png"), "{same}");
        }
        assert_ne!(location("a/new/c.png"), location("a/b/new/c.png"));
        assert_ne!(location("a/b/c.png"), location("a/b/new/c.png"));
    }
}
