//! What lies in a folder, to be compared later.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Read;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Of a file its type, mode, length, time of change and checksum (of the first megabyte: some files are sparse and huge).
#[derive(Debug, PartialEq)]
pub(crate) struct Entry {
    mode: u32,
    bytes: u64,
    changed: (i64, i64),
    checksum: u32,
    link: Option<PathBuf>,
}

/// All below a folder, links as links, and pipes unopened.
pub(crate) fn snapshot(folder: &Path) -> BTreeMap<PathBuf, Entry> {
    let mut found = BTreeMap::new();
    for path in fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path()) {
        let about = fs::symlink_metadata(&path).unwrap();
        if about.is_dir() {
            found.extend(snapshot(&path));
        }
        let mut start = Vec::new();
        if about.is_file() {
            File::open(&path).unwrap().take(1 << 20).read_to_end(&mut start).unwrap();
        }
        // A folder changes with its entries, which are compared themselves.
        let (bytes, changed) =
            if about.is_dir() { (0, (0, 0)) } else { (about.len(), (about.mtime(), about.mtime_nsec())) };
        let checksum = crc32fast::hash(&start);
        let link = fs::read_link(&path).ok();
        found.insert(path, Entry { mode: about.mode(), bytes, changed, checksum, link });
    }
    found
}
