//! `liveview.json` in a folder of pictures: which job they belong to and which of them are done, for `render --resume`. A shard's is
//! `liveview_I_of_N.json`, and names all pictures of the job, for `join`.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Error, Result, anyhow, bail};
use liveview::fs::atomic::AtomicFile;
use liveview::fs::bounded;
use liveview::image::Score;
use liveview::{LayerSpec, Shot};
use liveview_common::args::layers::LayerArgs;
use liveview_common::args::targets::TargetArgs;
use liveview_common::console::{print_message, shown};
use liveview_common::job::Job;
use serde_json::{Map, Value, json};

use super::record_text::{END, line, parse, whole};
use super::rendered::Rendered;
use crate::shard::Shard;

/// Stored on the disk no more often than this: what a power cut takes is rendered again.
const STORED: Duration = Duration::from_secs(1);

/// What the pictures depend on, by name; the first that differs is reported, so the most telling ones come first.
pub(super) type Fields = Vec<(&'static str, String)>;

/// The fields of a job. Threads and batch are not among them: pictures do not depend on these.
pub(super) fn fields(job: &Job, shots: &[Shot], targets: &TargetArgs, layers: &LayerArgs) -> Result<Fields> {
    let scene = job.scene();
    let root = scene.root.canonicalize().unwrap_or_else(|_| scene.root.clone());
    let first = &shots[0];
    let model = match job.model.path() {
        Some(path) => format!("{}, {}", path.file_name().unwrap_or_default().display(), digest_of(path)?),
        None => "none".to_owned(),
    };
    let mut cameras = String::new();
    let mut views = BTreeSet::new();
    if matches!(job.layers(), LayerSpec::Surface(_)) {
        // A photo's depth depends on photos around it, its range on all.
        let held_out = &first.held_out;
        views.extend((0..scene.views.len()).filter(|view| !held_out.contains(view)));
        let ranges: Vec<_> = views.iter().map(|&view: &usize| scene.views[view].depth_range).collect();
        cameras += &format!("{ranges:?}\n");
    }
    for shot in shots {
        cameras += &format!("{} {:?} {:?} {:?} {:?}\n", shot.name, shot.target, shot.near, shot.far, shot.views);
        views.extend(&shot.views);
    }
    let mut photos = String::new();
    for view in views.into_iter().map(|view: usize| &scene.views[view]) {
        cameras += &format!("{:?} {:?} {:?}\n", view.camera, view.native_camera(), view.distortion());
        photos += &format!("{} {}\n", view.name, digest_of(view.image_path())?);
    }
    Ok(vec![
        ("liveview", env!("CARGO_PKG_VERSION").to_owned()),
        ("scene", shown(&root)),
        ("targets", targets.to_string()),
        ("layers", job.layers().to_string()),
        ("exposure", (if layers.keep_exposure { "kept" } else { "balanced" }).to_owned()),
        ("sharpness", (if layers.keep_sharpness { "kept" } else { "balanced" }).to_owned()),
        ("model", model),
        ("alpha", job.alpha().to_string()),
        ("engine", job.model.engine()),
        ("size", format!("{}x{}", first.target.width(), first.target.height())),
        ("depth", format!("{} to {}", first.near, first.far)),
        ("cameras", digest(cameras.as_bytes())),
        ("photos", digest(photos.as_bytes())),
    ])
}

/// A digest of a file's contents.
pub(crate) fn digest(bytes: &[u8]) -> String {
    format!("crc32 {:08x}", crc32fast::hash(bytes))
}

fn digest_of(path: &Path) -> Result<String> {
    Ok(digest(&bounded::read(path, bounded::MAX_BYTES).with_context(|| format!("{}: cannot be read", path.display()))?))
}

/// The name of a record.
pub(crate) fn name(shard: Option<Shard>) -> String {
    shard.map_or_else(
        || "liveview.json".to_owned(),
        |Shard { index, count }| format!("liveview_{}_of_{count}.json", index + 1),
    )
}

/// The record of the job that writes into a folder: JSON that is written anew with the first picture, and gets a line more with each
/// further one. Of several jobs at once the last to begin counts.
pub(super) struct Record {
    path: PathBuf,
    fields: Fields,
    /// The shard, and the names of all pictures of the job.
    shard: Option<(Shard, Vec<String>)>,
    done: Map<String, Value>,
    /// Open from the first picture on; when it was last stored.
    file: Option<(File, Instant)>,
}

impl Record {
    /// The record of a new job; it replaces an earlier one's with the first picture.
    pub(super) fn new(folder: &Path, fields: Fields, shard: Option<(Shard, Vec<String>)>) -> Self {
        let path = folder.join(name(shard.as_ref().map(|(shard, _)| *shard)));
        Self { path, fields, shard, done: Map::new(), file: None }
    }

    /// Keeps the pictures that an earlier run of the same job has written, if their files are unchanged; `wanted` are the names and
    /// the files of all pictures. Files under temporary names are left alone: another process may be writing them.
    pub(super) fn resume(&mut self, wanted: &[(&str, Vec<PathBuf>)]) -> Result<()> {
        let at = self.path.display();
        let text = match bounded::read(&self.path, bounded::MAX_JSON_BYTES) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => {
                let Some(file) = wanted.iter().flat_map(|(_, files)| files).find(|file| file.exists()) else {
                    return Ok(());
                };
                bail!(
                    "--resume: {at} is missing, which says which job {} belongs to; expected it, or another folder, or no \
                     --resume, which overwrites",
                    file.display()
                );
            }
            Err(error) => bail!("--resume: {at}: cannot be read: {error}"),
        };
        let mut found = parse(&text).map_err(|error| anyhow!("--resume: {at}: not JSON: {error}"))?;
        for (field, here) in &self.fields {
            let there = found["job"][field].as_str().unwrap_or("missing");
            if there != here {
                bail!(
                    "--resume: {at} is of another job: \"{field}\" is {there} there and {here} here; expected the same, or \
                     another folder, or no --resume, which overwrites"
                );
            }
        }
        let Some(done) = found["done"].as_object_mut() else {
            bail!("--resume: {at}: \"done\": expected an object, a picture each");
        };
        for (name, files) in wanted {
            let entry = done.get_mut(*name).map(Value::take).unwrap_or_default();
            let unchanged = |file: &PathBuf| digest_of(file).is_ok_and(|digest| lists(&entry, &digest));
            if files.iter().all(unchanged) {
                self.done.insert((*name).to_owned(), entry);
            }
        }
        print_message("note", format!("{} of {} pictures were there", self.done.len(), wanted.len()));
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
            unseen: number("seen_by_no_view")?,
            hidden: number("hidden_from_all_views")?,
            disparity_max: number("disparity_max")? as f32,
            files,
        })
    }

    /// Records a picture whose files are written, with their digests.
    pub(super) fn add(&mut self, one: &Rendered, digests: Vec<String>) -> Result<()> {
        let entry = json!({
            "files": digests, "layers": one.layers, "psnr": one.score.as_ref().map(|score| score.psnr),
            "ssim": one.score.as_ref().map(|score| score.ssim), "seen_by_no_view": one.unseen, "hidden_from_all_views": one.hidden, "disparity_max": one.disparity_max,
        });
        self.append(&one.shot.name, entry).map_err(|error| self.unwritten(&error))
    }

    fn append(&mut self, name: &str, entry: Value) -> io::Result<()> {
        let Some((file, stored)) = &mut self.file else {
            self.done.insert(name.to_owned(), entry);
            return self.write().inspect_err(|_| drop(self.done.remove(name)));
        };
        let next = if self.done.is_empty() { "" } else { ",\n" };
        let line = line(name, &entry);
        file.seek(SeekFrom::End(-(END.len() as i64)))?;
        file.write_all(format!("{next}{line}{END}").as_bytes())?;
        if stored.elapsed() > STORED {
            file.sync_data()?;
            *stored = Instant::now();
        }
        self.done.insert(name.to_owned(), entry);
        Ok(())
    }

    /// Writes the record of a shard before its first picture: that it has begun, and what the others are.
    pub(super) fn begin(&mut self) -> Result<()> {
        if self.shard.is_some() { self.write().map_err(|error| self.unwritten(&error)) } else { Ok(()) }
    }

    /// Writes the file anew.
    fn write(&mut self) -> io::Result<()> {
        let job: Map<_, _> = self.fields.iter().map(|(field, value)| ((*field).to_owned(), json!(value))).collect();
        let mut members = vec![("job", Value::Object(job))];
        if let Some((Shard { index, count }, targets)) = &self.shard {
            members.push(("shard", json!({ "index": index + 1, "count": count })));
            members.push(("targets", json!(targets)));
        }
        let mut file = AtomicFile::create(&self.path)?;
        file.write_all(whole(&members, &self.done).as_bytes())?;
        self.file = Some((file.finish_open()?, Instant::now()));
        Ok(())
    }

    fn unwritten(&self, error: &io::Error) -> Error {
        anyhow!("{}: cannot be written: {error}", self.path.display())
    }

    /// After a failure, prints how to continue.
    pub(super) fn print_how_to_resume(&self, wanted: usize) {
        let (done, folder) = (self.done.len(), self.path.parent().unwrap_or(Path::new("")).display());
        if done > 0 {
            let note = format!("{done} of {wanted} pictures are in {folder}; the same with --resume renders the rest");
            print_message("note", note);
        }
    }
}

/// Whether an entry lists a file of these contents.
fn lists(entry: &Value, digest: &str) -> bool {
    entry["files"].as_array().is_some_and(|files| files.iter().any(|file| file == digest))
}
