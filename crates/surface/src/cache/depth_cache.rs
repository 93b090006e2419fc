//! A folder of depth maps.

use std::io;
use std::path::{Path, PathBuf};

use super::file;
use super::key::DepthKey;
use crate::search::PhotoDepth;
use liveview_files::atomic::{AtomicFile, is_special};
use liveview_files::bounded;

/// A folder of depth maps.
#[derive(Debug, Clone)]
pub struct DepthCache {
    folder: PathBuf,
}

impl DepthCache {
    /// Opens the folder, which is created if it is missing, and checks that files can be written
    /// there.
    pub fn open(folder: &Path) -> io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        AtomicFile::create(&folder.join("depth.npz"))?;
        Ok(Self { folder: folder.to_owned() })
    }

    fn path(&self, key: &DepthKey) -> PathBuf {
        self.folder.join(format!("{key}.npz"))
    }

    /// The depth of this key, if there is a file of it. The error is one line, which names the
    /// file.
    pub fn load(&self, key: &DepthKey) -> Result<Option<PhotoDepth>, String> {
        let path = self.path(key);
        let bytes = match bounded::read_regular(&path, file::max_bytes(key)) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(format!("{}: cannot be read: {error}", path.display())),
        };
        file::read(&bytes, key).map(Some).map_err(|damage| format!("{}: {damage}", path.display()))
    }

    /// Stores a depth. The error is one line, which names the file.
    pub fn store(&self, key: &DepthKey, depth: &PhotoDepth) -> Result<(), String> {
        let path = self.path(key);
        let unwritten = |why: &dyn std::fmt::Display| format!("{}: cannot be written: {why}", path.display());
        file::check(depth, key).map_err(|damage| unwritten(&damage))?;
        if is_special(&path) {
            return Err(unwritten(&"a pipe or a device; expected a regular file, or none"));
        }
        let file = AtomicFile::create(&path).map_err(|error| unwritten(&error))?;
        let file = file::write(file, key, depth).map_err(|error| unwritten(&file::root_cause(&error)))?;
        file.finish().map_err(|error| unwritten(&error))
    }
}
