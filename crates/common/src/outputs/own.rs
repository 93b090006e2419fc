//! Files that the program wrote itself.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use liveview::fs::bounded;
use liveview::image::has_mark;
use serde_json::Value;

use crate::args::output::has_ending;

/// Bytes in which the mark of a picture stands.
const START: u64 = 256;

/// Whether a file bears the program's mark: a picture of its own, or JSON that says so.
pub(super) fn is_own(file: &Path) -> bool {
    if has_ending(file, &["json"]) {
        let read = || bounded::read(file, bounded::MAX_JSON_BYTES).ok();
        let json = read().and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok()).unwrap_or_default();
        return json["job"]["liveview"].is_string() || json["liveview"].is_string();
    }
    if has_ending(file, &["npy"]) {
        // An array bears no mark; those of `liveview depth` have a picture and its scale beside them.
        let stem = file.file_stem().unwrap_or_default();
        return [".png", "_scale.json"].iter().all(|ending| {
            let mut name = stem.to_owned();
            name.push(ending);
            is_own(&file.with_file_name(name))
        });
    }
    let mut start = Vec::new();
    File::open(file).and_then(|file| file.take(START).read_to_end(&mut start)).is_ok() && has_mark(&start)
}
