//! Recognises files that the program wrote.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use liveview::fs::bounded;
use liveview::image::is_tagged;
use serde_json::Value;

use crate::args::output::has_extension;

/// Bytes at the start of a picture file that include the program's tag.
const TAGGED_BYTES: u64 = 256;

/// Whether the program wrote a file: a tagged picture, or JSON with the program's fields.
pub(super) fn is_own(file: &Path) -> bool {
    if has_extension(file, &["json"]) {
        let read = || bounded::read(file, bounded::MAX_JSON_BYTES).ok();
        let json = read().and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok()).unwrap_or_default();
        return json["job"]["liveview"].is_string() || json["liveview"].is_string();
    }
    if has_extension(file, &["npy"]) {
        // An array has no tag; `liveview depth` writes a picture and its scale next to each.
        let stem = file.file_stem().unwrap_or_default();
        return [".png", "_scale.json"].iter().all(|ending| {
            let mut name = stem.to_owned();
            name.push(ending);
            is_own(&file.with_file_name(name))
        });
    }
    let mut start = Vec::new();
    File::open(file).and_then(|file| file.take(TAGGED_BYTES).read_to_end(&mut start)).is_ok() && is_tagged(&start)
}
