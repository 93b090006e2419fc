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
        let json = json(file);
        // The last is of a log, which has a line for each frame.
        return json["job"]["liveview"].is_string() || json["liveview"].is_string() || json["layers_from"].is_string();
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
    let mut read = || File::open(file).and_then(|file| file.take(TAGGED_BYTES).read_to_end(&mut start));
    file.is_file() && read().is_ok() && is_tagged(&start)
}

/// Whether a file is the record of a run, which lists the pictures that are done.
pub(super) fn is_record(file: &Path) -> bool {
    has_extension(file, &["json"]) && {
        let json = json(file);
        json["job"]["liveview"].is_string() && json["done"].is_object()
    }
}

/// The JSON of a file, or of its first line; null if it is neither.
fn json(file: &Path) -> Value {
    let bytes = bounded::read_regular(file, bounded::MAX_JSON_BYTES).unwrap_or_default();
    let bytes = bounded::without_byte_order_mark(&bytes);
    let first_line = || bytes.split(|&byte| byte == b'\n').next().unwrap_or_default();
    serde_json::from_slice(bytes).or_else(|_| serde_json::from_slice(first_line())).unwrap_or_default()
}
