//! Files of untrusted size: read up to a limit, written completely or not at all. Memory: checked before
//! allocation.

pub mod atomic;
pub mod bounded;
pub mod memory;
pub mod npy;
pub mod unfinished;

use std::path::Path;

/// Whether a file's extension is one of these, in upper or lower case.
pub fn has_extension(file: &Path, extensions: &[&str]) -> bool {
    file.extension().is_some_and(|found| extensions.iter().any(|extension| found.eq_ignore_ascii_case(extension)))
}
