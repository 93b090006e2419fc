//! Whether a library file is whole, by its ELF header. One that is cut short is loaded all the same, and ends the process (SIGBUS) at
//! the first page that is not there.

use std::fs::File;
use std::path::Path;

use object::read::elf::{FileHeader as _, ProgramHeader as _};
use object::{Endianness, ReadCache, elf::FileHeader64};

/// Refuses a 64-bit ELF file that is shorter than its header says; any other file is left to the loader.
pub(super) fn check(path: &Path) -> Result<(), String> {
    let file = File::open(path).map_err(|error| error.to_string())?;
    let length = file.metadata().map_err(|error| error.to_string())?.len();
    let data = ReadCache::new(file);
    let Ok(header) = FileHeader64::<Endianness>::parse(&data) else { return Ok(()) };
    let endian = header.endian().map_err(|error| error.to_string())?;
    let sections = u64::from(header.e_shnum.get(endian)) * u64::from(header.e_shentsize.get(endian));
    let sections_end = header.e_shoff.get(endian).saturating_add(sections);
    let cut_short = |needed: u64| format!("the file is cut short: {length} bytes of at least {needed}");
    let segments = header.program_headers(endian, &data).map_err(|_| cut_short(sections_end))?;
    let ends = segments.iter().map(|segment| segment.p_offset(endian).saturating_add(segment.p_filesz(endian)));
    let needed = ends.max().unwrap_or(0).max(sections_end);
    if needed > length { Err(cut_short(needed)) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_that_is_cut_short_is_told_from_a_whole_one_and_from_other_files() {
        let whole = std::fs::read(std::env::current_exe().unwrap()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("library.so");
        let check = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            check(&path)
        };
        for other in [&b""[..], b"#!/bin/sh\n", &whole[..40]] {
            assert_eq!(check(other), Ok(()));
        }
        if whole.starts_with(b"\x7fELF\x02") {
            assert_eq!(check(&whole), Ok(()));
            for length in [100, 4096, whole.len() / 2, whole.len() - 1] {
                let refused = check(&whole[..length]).unwrap_err();
                assert!(refused.contains(&format!("cut short: {length} bytes of at least ")), "{refused}");
            }
        }
    }
}
