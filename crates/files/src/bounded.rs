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
    let (file, mut bytes) = (File::open(path)?, Vec::new());
    if file.metadata()?.len() > limit {
        return Err(too_large(limit));
    }
    // A device or a pipe does not report its size beforehand.
    file.take(limit + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit { Err(too_large(limit)) } else { Ok(bytes) }
}

/// As [`read`], of a regular file: opening a pipe could block for ever.
///
/// # Errors
///
/// Those of [`read`] and [`check_regular`].
pub fn read_regular(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    check_regular(path)?;
    read(path, limit)
}

/// A text without the byte order mark at its start, which some editors put there.
pub fn without_byte_order_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix("\u{feff}".as_bytes()).unwrap_or(text)
}

/// Checks that a path names a regular file, or leads to one by links.
///
/// # Errors
///
/// Those of the file system; [`io::ErrorKind::IsADirectory`] for a folder;
/// [`io::ErrorKind::InvalidInput`] for a pipe or a device. The error says what it is.
pub fn check_regular(path: &Path) -> io::Result<()> {
    let about = path.metadata().map_err(|error| match path.symlink_metadata() {
        Ok(_) if error.kind() == io::ErrorKind::NotFound => io::Error::new(error.kind(), "a link to no file"),
        _ => error,
    })?;
    match (about.is_file(), about.is_dir()) {
        (true, _) => Ok(()),
        (_, true) => Err(io::Error::new(io::ErrorKind::IsADirectory, "a folder; expected a file")),
        _ => Err(io::Error::new(io::ErrorKind::InvalidInput, "a pipe or a device; expected a regular file")),
    }
}

fn too_large(limit: u64) -> io::Error {
    io::Error::new(
        io::ErrorKind::FileTooLarge,
        format!("the file has more than {limit} bytes, the largest size that is read"),
    )
}
