//! Files read up to a size limit: a larger file is refused before memory is allocated for it.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Largest size of photos, COLMAP models and arrays, bytes.
pub const MAX_BYTES: u64 = 1 << 30;

/// Largest size of JSON, bytes: parsed, it takes up to 16 times the memory.
pub const MAX_JSON_BYTES: u64 = 64 << 20;

/// All bytes of a file.
///
/// # Errors
///
/// Those of the file system; [`io::ErrorKind::FileTooLarge`] for more than `limit` bytes.
pub fn read(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    // A device or a pipe does not report its size beforehand.
    open(path, limit)?.take(limit + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit { Err(too_large(limit)) } else { Ok(bytes) }
}

/// Opens a file of at most `limit` bytes.
pub(crate) fn open(path: &Path, limit: u64) -> io::Result<File> {
    let file = File::open(path)?;
    if file.metadata()?.len() > limit { Err(too_large(limit)) } else { Ok(file) }
}

fn too_large(limit: u64) -> io::Error {
    io::Error::new(
        io::ErrorKind::FileTooLarge,
        format!("the file has more than {limit} bytes, the largest size that is read"),
    )
}
