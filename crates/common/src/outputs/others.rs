//! Pictures of earlier runs in an output folder.

use std::path::Path;

use crate::args::output::has_extension;
use crate::console::print_message;

/// Prints a note if a folder holds pictures that this run did not write.
pub fn note_other_pictures(folder: &Path, is_written: impl Fn(&Path) -> bool) {
    let listed = if folder == Path::new("") { Path::new(".") } else { folder };
    let entries = std::fs::read_dir(listed).into_iter().flatten().flatten().map(|entry| entry.file_name());
    let hidden = |name: &std::ffi::OsString| name.as_encoded_bytes().starts_with(b".");
    let mut others: Vec<_> = entries
        .filter(|name| {
            has_extension(name.as_ref(), &["png", "jpg", "jpeg"]) && !hidden(name) && !is_written(&folder.join(name))
        })
        .collect();
    others.sort();
    if let Some(first) = others.first() {
        let (count, listed, first) = (others.len(), listed.display(), first.display());
        print_message(
            "note",
            format!("{listed} holds {count} other pictures, which this run did not write, such as {first}"),
        );
    }
}
