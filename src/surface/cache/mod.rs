//! Depth of photos kept in a folder, so that a later run finds it there.
//!
//! One file ([`mod@file`]) for the depth of one photo, named by a digest of all that the depth depends on ([`key`]): what is found under a
//! name never has to be checked for being outdated, scenes and settings share a folder, and any file may be deleted at any time. A file
//! has its name only once it is whole, so several processes may share a folder: of two that find the same depth the last one's file
//! stands, and both are the same. A held-out photo takes part in no key, as it is in no photo's neighbours.

mod file;
mod key;
#[cfg(test)]
mod tests;

use std::io;
use std::path::{Path, PathBuf};

#[cfg(fuzzing)]
pub(crate) use file::Damage;
pub(crate) use key::{DepthKey, PhotoDigest};

use super::PhotoDepth;
use crate::fs::atomic::AtomicFile;
use crate::fs::bounded;

/// A folder of depths.
#[derive(Debug, Clone)]
pub(crate) struct DepthCache {
    folder: PathBuf,
}

impl DepthCache {
    /// The folder, made if there is none; files can be written there.
    pub(crate) fn open(folder: &Path) -> io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        AtomicFile::create(&folder.join("depth.npz"))?;
        Ok(Self { folder: folder.to_owned() })
    }

    fn path(&self, key: &DepthKey) -> PathBuf {
        self.folder.join(format!("{key}.npz"))
    }

    /// The depth of this key, if it is there. The error is one line, which names the file.
    pub(crate) fn load(&self, key: &DepthKey) -> Result<Option<PhotoDepth>, String> {
        let path = self.path(key);
        let bytes = match bounded::read(&path, file::most_bytes(key)) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(format!("{}: cannot be read: {error}", path.display())),
        };
        file::read(&bytes, key).map(Some).map_err(|damage| format!("{}: {damage}", path.display()))
    }

    /// Keeps a depth. The error is one line, which names the file.
    pub(crate) fn store(&self, key: &DepthKey, depth: &PhotoDepth) -> Result<(), String> {
        let path = self.path(key);
        let unwritten = |why: &dyn std::fmt::Display| format!("{}: cannot be written: {why}", path.display());
        file::check(depth, key).map_err(|damage| unwritten(&damage))?;
        let file = AtomicFile::create(&path).map_err(|error| unwritten(&error))?;
        let file = file::write(file, key, depth).map_err(|error| unwritten(&error))?;
        file.finish().map_err(|error| unwritten(&error))
    }
}

/// Reads the file of a depth of 7×5 pixels between 2 and 8, the bytes of its key all 7.
#[cfg(fuzzing)]
pub(crate) fn read(bytes: &[u8]) -> Result<PhotoDepth, Damage> {
    let size = crate::geometry::Size::new(7, 5);
    file::read(bytes, &DepthKey { digest: [7; 32], size, near: 2.0, far: 8.0 })
}
