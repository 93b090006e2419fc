//! Snapshots of a folder, to detect changes.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Read;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use crate::scene_common::crc32;

/// A file's type and mode, length, modification time, checksum of the first megabyte (some files
/// are huge and sparse) and link target.
#[derive(Debug, PartialEq)]
pub(crate) struct Entry {
    mode: u32,
    bytes: u64,
    changed: (i64, i64),
    checksum: u32,
    link: Option<PathBuf>,
}

/// Everything in a folder and its subfolders; links are not followed and pipes are not opened.
pub(crate) fn snapshot(folder: &Path) -> BTreeMap<PathBuf, Entry> {
    let mut found = BTreeMap::new();
    for path in fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path()) {
        let metadata = fs::symlink_metadata(&path).unwrap();
        if metadata.is_dir() {
            found.extend(snapshot(&path));
        }
        let mut start = Vec::new();
        if metadata.is_file() {
            File::open(&path).unwrap().take(1 << 20).read_to_end(&mut start).unwrap();
        }
        // A folder's metadata changes with its entries, which are compared separately.
        let (bytes, changed) =
            if metadata.is_dir() { (0, (0, 0)) } else { (metadata.len(), (metadata.mtime(), metadata.mtime_nsec())) };
        let checksum = crc32(&start);
        let link = fs::read_link(&path).ok();
        found.insert(path, Entry { mode: metadata.mode(), bytes, changed, checksum, link });
    }
    found
}
