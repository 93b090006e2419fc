//! Pictures that an earlier run has left in a folder.

use std::path::Path;

use crate::args::output::has_ending;
use crate::console::print_message;

/// Tells which pictures of a folder are not those written.
pub fn note_other_pictures(folder: &Path, is_written: impl Fn(&Path) -> bool) {
    let listed = if folder == Path::new("") { Path::new(".") } else { folder };
    let entries = std::fs::read_dir(listed).into_iter().flatten().flatten().map(|entry| entry.file_name());
    let hidden = |name: &std::ffi::OsString| name.as_encoded_bytes().starts_with(b".");
    let mut others: Vec<_> = entries
        .filter(|name| {
            has_ending(name.as_ref(), &["png", "jpg", "jpeg"]) && !hidden(name) && !is_written(&folder.join(name))
        })
        .collect();
    others.sort();
    if let Some(first) = others.first() {
        let (count, listed, first) = (others.len(), listed.display(), first.display());
        print_message(
            "note",
            format!("{count} other pictures are in {listed}, which this run has not made: {first} first"),
        );
    }
}
