//! The record of a job, `liveview.json` in a folder of pictures: the job's options and the finished
//! pictures, for `render --resume`. That of `--frames A:B` is `liveview_A_B.json`.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use liveview_files::atomic::{AtomicFile, is_special};
use liveview_files::bounded;
use liveview_synthesizer::Score;
use liveview_synthesizer::Shot;
use serde_json::{Map, Value, json};

use super::summary::Rendered;
use crate::args::numbers::FrameRange;
use crate::args::{LayerArgs, TargetArgs};
use crate::console::{path_text, print_message};
use crate::job::Job;

/// Minimum interval between flushes to disk: pictures whose entries a power cut loses are rendered
/// again.
const FLUSH_INTERVAL: Duration = Duration::from_secs(1);

/// Names and values of everything that the pictures depend on. The first difference is reported, so
/// the most informative ones come first.
pub(super) type Fields = Vec<(&'static str, String)>;

/// The fields of a job. Pictures do not depend on the number of threads and the batch size.
pub(super) fn fields(job: &Job, shots: &[Shot], targets: &TargetArgs, layers: &LayerArgs) -> Result<Fields> {
    let scene = job.synthesizer.scene();
    let root = scene.root.canonicalize().unwrap_or_else(|_| scene.root.clone());
    let first = &shots[0];
    let model = match job.model.path() {
        Some(path) => format!("{}, {}", path.file_name().unwrap_or_default().display(), digest_of(path)?),
        None => "none".to_owned(),
    };
    let mut cameras = String::new();
    let mut views = BTreeSet::new();
    if job.synthesizer.uses_depth() {
        // The depth of a photo depends on its neighbours, and the depth range on all photos.
        let held_out = &first.held_out;
        views.extend((0..scene.views.len()).filter(|view| !held_out.contains(view)));
        let ranges: Vec<_> = views.iter().map(|&view: &usize| scene.views[view].depth_range).collect();
        cameras += &format!("{ranges:?}\n");
    }
    // Of the same range, planes are others where it is given than where it is refined.
    let is_refined =
        first.refines_range && job.synthesizer.uses_depth() && job.synthesizer.layers().kind() != "surface";
    for shot in shots {
        cameras += &format!("{} {:?} {:?} {:?} {:?}\n", shot.name, shot.target, shot.near, shot.far, shot.views);
        views.extend(&shot.views);
    }
    let mut photos = String::new();
    for view in views.into_iter().map(|view: usize| &scene.views[view]) {
        cameras += &format!("{:?} {:?} {:?}\n", view.camera, view.native_camera(), view.distortion());
        photos += &format!("{} {}\n", view.name, digest_of(view.image_path())?);
    }
    let correction = layers.photo_correction();
    Ok(vec![
        ("liveview", env!("CARGO_PKG_VERSION").to_owned()),
        ("scene", path_text(&root)),
        ("targets", targets.to_string()),
        ("layers", job.synthesizer.layers().to_string()),
        ("exposure", (if correction.exposure { "balanced" } else { "kept" }).to_owned()),
        ("sharpness", (if correction.sharpness { "balanced" } else { "kept" }).to_owned()),
        ("model", model),
        ("alpha", job.synthesizer.renderer().alpha().to_string()),
        ("engine", job.model.engine()),
        ("size", format!("{}x{}", first.target.width(), first.target.height())),
        ("depth", format!("{} to {}{}", first.near, first.far, if is_refined { " at most" } else { "" })),
        ("cameras", digest(cameras.as_bytes())),
        ("photos", digest(photos.as_bytes())),
    ])
}

/// The digest of a file's contents.
pub(super) fn digest(bytes: &[u8]) -> String {
    format!("crc32 {:08x}", crc32fast::hash(bytes))
}

fn digest_of(path: &Path) -> Result<String> {
    Ok(digest(
        &bounded::read_regular(path, bounded::MAX_BYTES)
            .with_context(|| format!("{}: cannot be read", path.display()))?,
    ))
}

/// The file name of a record.
pub(super) fn name(frames: Option<&FrameRange>) -> String {
    let of_frames = |frames: &FrameRange| format!("liveview_{}_{}.json", frames.start, frames.end);
    frames.map_or_else(|| "liveview.json".to_owned(), of_frames)
}

/// The record of the job that writes to a folder: JSON that is created with the first picture and
/// extended by a line with each further one. If several jobs write to a folder at once, the record
/// is that of the last to start.
pub(super) struct Record {
    path: PathBuf,
    fields: Fields,
    done: Map<String, Value>,
    /// The file, open from the first picture on, and the time of the last flush.
    file: Option<(File, Instant)>,
}

impl Record {
    /// The record of a new job, which replaces the file of an earlier one with its first picture.
    pub(super) fn new(path: PathBuf, fields: Fields) -> Self {
        Self { path, fields, done: Map::new(), file: None }
    }

    /// Keeps the pictures of an earlier run of the same job, if their files are unchanged; `wanted`
    /// are the names and files of all pictures. Temporary files are not deleted, since another
    /// process may be writing them.
    pub(super) fn resume(&mut self, wanted: &[(&str, Vec<PathBuf>)]) -> Result<()> {
        let at = self.path.display();
        let text = match bounded::read_regular(&self.path, bounded::MAX_JSON_BYTES) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => {
                let Some(file) = wanted.iter().flat_map(|(_, files)| files).find(|file| file.exists()) else {
                    return Ok(());
                };
                bail!(
                    "--resume: {} exists, but {at} is missing, which records the job that wrote it; expected that \
                     file or another output folder. Without --resume the pictures are overwritten",
                    file.display()
                );
            }
            Err(error) => bail!("--resume: {at}: cannot be read: {error}"),
        };
        let mut found = parse(&text).map_err(|error| anyhow!("--resume: {at}: not JSON: {error}"))?;
        for (field, expected) in &self.fields {
            let recorded = found["job"][field].as_str().unwrap_or("missing");
            if recorded != expected {
                bail!(
                    "--resume: {at} is of another job: \"{field}\" is {recorded}, expected {expected}, another folder, \
                     or no --resume to overwrite"
                );
            }
        }
        let Some(done) = found["done"].as_object_mut() else {
            bail!("--resume: {at}: \"done\": expected an object with an entry for each picture");
        };
        for (name, files) in wanted {
            if let Some(file) = files.iter().find(|file| is_special(file)) {
                let file = file.display();
                bail!("--resume: {file}: not a regular file; expected a file of an earlier run, or none");
            }
            let entry = done.get_mut(*name).map(Value::take).unwrap_or_default();
            let unchanged = |file: &PathBuf| digest_of(file).is_ok_and(|digest| lists(&entry, &digest));
            if files.iter().all(unchanged) {
                self.done.insert((*name).to_owned(), entry);
            }
        }
        print_message("note", format!("{} of {} pictures are kept", self.done.len(), wanted.len()));
        Ok(())
    }

    /// The picture of a shot, if it is kept.
    pub(super) fn kept(&self, shot: &Shot, files: Vec<PathBuf>) -> Option<Rendered> {
        let entry = self.done.get(&shot.name)?;
        let number = |key: &str| entry[key].as_f64();
        let score = number("psnr").zip(number("ssim")).map(|(psnr, ssim)| Score { psnr, ssim });
        Some(Rendered {
            shot: shot.clone(),
            layers: entry["layers"].as_u64()? as usize,
            times: None,
            score,
            psnr_covered: number("psnr_covered"),
            uncovered_share: number("uncovered_share")?,
            guessed_share: number("guessed_share"),
            advice: None,
            occluded_share: number("occluded_share")?,
            confirmed_share: None,
            agreeing_share: None,
            disparity_max: number("disparity_max")? as f32,
            files,
        })
    }

    /// Adds a picture whose files are written, with their digests.
    pub(super) fn add(&mut self, one: &Rendered, digests: Vec<String>) -> Result<()> {
        let entry = json!({
            "files": digests, "layers": one.layers, "psnr": one.score.as_ref().map(|score| score.psnr),
            "ssim": one.score.as_ref().map(|score| score.ssim), "psnr_covered": one.psnr_covered,
            "guessed_share": one.guessed_share, "uncovered_share": one.uncovered_share,
            "occluded_share": one.occluded_share, "disparity_max": one.disparity_max,
        });
        self.append(&one.shot.name, entry)
            .map_err(|error| anyhow!("{}: cannot be written: {error}", self.path.display()))
    }

    fn append(&mut self, name: &str, entry: Value) -> io::Result<()> {
        let Some((file, flushed)) = &mut self.file else {
            self.done.insert(name.to_owned(), entry);
            return self.write().inspect_err(|_| drop(self.done.remove(name)));
        };
        let separator = if self.done.is_empty() { "" } else { ",\n" };
        let line = line(name, &entry);
        file.seek(SeekFrom::End(-(END.len() as i64)))?;
        file.write_all(format!("{separator}{line}{END}").as_bytes())?;
        if flushed.elapsed() > FLUSH_INTERVAL {
            file.sync_data()?;
            *flushed = Instant::now();
        }
        self.done.insert(name.to_owned(), entry);
        Ok(())
    }

    /// Writes the whole file.
    fn write(&mut self) -> io::Result<()> {
        let job: Map<_, _> = self.fields.iter().map(|(field, value)| ((*field).to_owned(), json!(value))).collect();
        let lines: Vec<String> = self.done.iter().map(|(name, entry)| line(name, entry)).collect();
        let text = format!("{{\"job\": {:#},\n\"done\": {{\n{}{END}", Value::Object(job), lines.join(",\n"));
        let mut file = AtomicFile::create(&self.path)?;
        file.write_all(text.as_bytes())?;
        self.file = Some((file.finish_open()?, Instant::now()));
        Ok(())
    }

    /// Prints how to continue after an error.
    pub(super) fn print_how_to_resume(&self, wanted: usize) {
        let (done, folder) = (self.done.len(), self.path.parent().unwrap_or(Path::new("")).display());
        if done > 0 {
            let note = format!("{done} of {wanted} pictures are in {folder}; add --resume to render the rest");
            print_message("note", note);
        }
    }
}

/// Whether an entry lists a file with this digest.
fn lists(entry: &Value, digest: &str) -> bool {
    entry["files"].as_array().is_some_and(|files| files.iter().any(|file| file == digest))
}

/// The text after the last picture's entry.
const END: &str = "\n}}\n";

/// The line of a picture.
fn line(name: &str, entry: &Value) -> String {
    format!("{}: {entry}", json!(name))
}

/// Parses a record; an incomplete last line is ignored.
fn parse(text: &[u8]) -> serde_json::Result<Value> {
    /// Line breaks that may follow the last complete line: its own, and those of [`END`].
    const MAX_LINE_BREAKS: usize = 3;
    let text = bounded::without_byte_order_mark(text);
    let mut record = serde_json::from_slice(text);
    let ends = text.iter().enumerate().rev().filter(|(_, byte)| **byte == b'\n');
    for (end, _) in ends.take(MAX_LINE_BREAKS) {
        record = record.or_else(|error| {
            let complete = text[..end].strip_suffix(b",").unwrap_or(&text[..end]);
            serde_json::from_slice(&[complete, END.as_bytes()].concat()).map_err(|_| error)
        });
    }
    record
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parse_reads_all_complete_lines_of_a_truncated_record() {
        let entries = ["a", "b", "c"].map(|name| line(name, &json!({ "files": [name] })));
        let start = format!("{{\"job\": {{}},\n\"done\": {{\n{},\n{}", entries[0], entries[1]);
        let (old, new) = (format!("{start}{END}"), format!("{start},\n{}{END}", entries[2]));
        for written in start.len()..=new.len() {
            // The new text overwrites the old one.
            let text = [&new[..written], old.get(written..).unwrap_or_default()].concat();
            let found = parse(text.as_bytes()).unwrap_or_else(|error| panic!("{text}: {error}"));
            let done: Vec<_> = found["done"].as_object().unwrap().keys().collect();
            assert!(!done.is_empty() && (done.len() > 1 || written < old.len()), "{text}: {done:?}");
        }
        assert!(parse(b"{").is_err() && parse(b"").is_err());
    }
}
