//! Refuses truncated library files: the loader maps them all the same, and the process is killed
//! (SIGBUS) at the first missing page.

use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Refuses a 64-bit little-endian ELF file that ends before its section headers do: linkers write
/// these last. Other files, and files that cannot be read, are left to the loader.
pub(super) fn check(path: &Path) -> Result<(), String> {
    let mut header = [0; 64];
    let read = File::open(path).and_then(|mut file| {
        file.read_exact(&mut header)?;
        file.metadata()
    });
    let (Ok(about), true) = (read, header.starts_with(b"\x7fELF\x02\x01")) else { return Ok(()) };
    let [e_shentsize, e_shnum] = [0x3A, 0x3C].map(|at| u64::from(u16::from_le_bytes([header[at], header[at + 1]])));
    let e_shoff = u64::from_le_bytes(std::array::from_fn(|i| header[0x28 + i]));
    let (length, needed) = (about.len(), e_shoff.saturating_add(e_shnum * e_shentsize));
    if length < needed { Err(format!("the file is truncated: {length} bytes, expected {needed}")) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_truncated_library_is_an_error_and_other_files_are_not() {
        let complete = std::fs::read(std::env::current_exe().unwrap()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("library.so");
        let check = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            check(&path)
        };
        for other in [&b""[..], b"#!/bin/sh\n", &complete[..40]] {
            assert_eq!(check(other), Ok(()));
        }
        if complete.starts_with(b"\x7fELF\x02\x01") {
            assert_eq!(check(&complete), Ok(()));
            for length in [100, 4096, complete.len() / 2, complete.len() - 1] {
                let refused = check(&complete[..length]).unwrap_err();
                assert!(refused.starts_with(&format!("the file is truncated: {length} bytes, expected ")), "{refused}");
            }
        }
    }
}
