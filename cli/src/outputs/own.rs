//! Recognises files that the program wrote: others are not replaced, and pictures of other runs are noted.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Result, bail};
use liveview::image::is_tagged;
use liveview_files::bounded;
use serde_json::Value;

use crate::args::output::has_extension;
use crate::console::print_message;

/// Bytes at the start of a picture file that include the program's tag.
const TAGGED_BYTES: u64 = 256;

/// What becomes of an existing file.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Existing {
    Replaced,
    /// Replaced under a name that the program chose: an earlier run may have left it damaged.
    ReplacedByName,
}

/// Checks that the program wrote an existing file that will be replaced; `scene` is the folder of
/// the scene that holds it.
pub(super) fn check(shown: &str, file: &Path, scene: Option<&Path>, existing: Existing) -> Result<()> {
    if existing == Existing::Replaced && is_record(file) {
        bail!("{shown}: would overwrite the record of a run; expected another file");
    }
    // Any JSON, because a scene or its cameras may consist of it.
    let is_protected = scene.is_some() || existing == Existing::Replaced && has_extension(file, &["json"]);
    if is_protected && !is_own(file) {
        let of = scene.map(|root| format!(" of the scene folder {}", root.display())).unwrap_or_default();
        bail!(
            "{shown}: would overwrite a file{of} that liveview did not write; expected another file, or that one moved \
             away"
        );
    }
    Ok(())
}

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
fn is_record(file: &Path) -> bool {
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

/// Prints a note if a folder holds pictures that this run did not write.
pub(crate) fn note_other_pictures(folder: &Path, is_written: impl Fn(&Path) -> bool) {
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
