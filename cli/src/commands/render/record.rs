//! `liveview.json` in a folder of pictures: of which job they are and which of them are done. `render --resume` goes by it.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use liveview::Shot;
use liveview::fs::bounded;
use liveview::image::Score;
use serde_json::{Map, Value, json};

use super::Rendered;
use crate::args::layers::LayerArgs;
use crate::args::output::write_whole;
use crate::args::targets::TargetArgs;
use crate::console::{shown, tell};
use crate::job::Job;

const NAME: &str = "liveview.json";

/// What the pictures depend on, each under its name; those that say most first.
pub(super) type Fields = Vec<(&'static str, String)>;

/// The fields of a job. Threads and batch are none: pictures do not depend on them.
pub(super) fn fields(job: &Job, shots: &[Shot], targets: &TargetArgs, layers: &LayerArgs) -> Result<Fields> {
    let scene = job.scene();
    let root = scene.root.canonicalize().unwrap_or_else(|_| scene.root.clone());
    let first = &shots[0];
    let model = &job.model.path;
    let mut cameras = String::new();
    let mut views = BTreeSet::new();
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
        ("opaque", layers.opaque.to_string()),
        ("model", format!("{}, {}", model.file_name().unwrap_or_default().display(), digest_of(model)?)),
        ("engine", job.model.described()),
        ("size", format!("{}x{}", first.target.width(), first.target.height())),
        ("depth", format!("{} to {}", first.near, first.far)),
        ("cameras", digest(cameras.as_bytes())),
        ("photos", digest(photos.as_bytes())),
    ])
}

/// What identifies contents.
pub(super) fn digest(bytes: &[u8]) -> String {
    format!("crc32 {:08x}", crc32fast::hash(bytes))
}

fn digest_of(path: &Path) -> Result<String> {
    Ok(digest(&bounded::read(path, bounded::MAX_BYTES).with_context(|| format!("{}: cannot be read", path.display()))?))
}

/// The record of the job that writes into a folder. It is written with each picture; the last of several jobs stands.
pub(super) struct Record {
    path: PathBuf,
    fields: Fields,
    done: Map<String, Value>,
}

impl Record {
    /// Of a job that begins: what an earlier one has recorded is forgotten with the first picture.
    pub(super) fn new(folder: &Path, fields: Fields) -> Self {
        Self { path: folder.join(NAME), fields, done: Map::new() }
    }

    /// Takes over what the same job has done before and what stands as it left it; `wanted` are the files of each picture. Files
    /// under temporary names are left alone: another process may be writing them.
    pub(super) fn resume(&mut self, wanted: &[(&str, Vec<PathBuf>)]) -> Result<()> {
        let at = self.path.display();
        let text = match fs::read_to_string(&self.path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                let Some(file) = wanted.iter().flat_map(|(_, files)| files).find(|file| file.exists()) else {
                    return Ok(());
                };
                bail!(
                    "--resume: {at} is missing, which tells of which job {} is; expected it, or another folder, or no --resume, \
                     which overwrites",
                    file.display()
                );
            }
            Err(error) => bail!("--resume: {at}: cannot be read: {error}"),
        };
        let mut found: Value =
            serde_json::from_str(&text).map_err(|error| anyhow!("--resume: {at}: not JSON: {error}"))?;
        for (field, ours) in &self.fields {
            let theirs = found["job"][field].as_str().unwrap_or("missing");
            if theirs != ours {
                bail!(
                    "--resume: {at} is of another job: \"{field}\" is {theirs} there and {ours} here; expected the same, or \
                     another folder, or no --resume, which overwrites"
                );
            }
        }
        for (name, files) in wanted {
            let entry = found["done"][name].take();
            let stands = |file: &PathBuf| digest_of(file).is_ok_and(|digest| told(&entry, &digest));
            if files.iter().all(stands) {
                self.done.insert((*name).to_owned(), entry);
            }
        }
        tell("note", format!("{} of {} pictures were there", self.done.len(), wanted.len()));
        Ok(())
    }

    /// A picture that was there.
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
            disparity_max: number("disparity_max")? as f32,
            files,
        })
    }

    /// Records a picture whose files are written, with the digests of them all.
    pub(super) fn add(&mut self, one: &Rendered, digests: Vec<String>) -> Result<()> {
        let entry = json!({
            "files": digests, "layers": one.layers, "psnr": one.score.as_ref().map(|score| score.psnr),
            "ssim": one.score.as_ref().map(|score| score.ssim), "seen_by_no_view": one.unseen, "disparity_max": one.disparity_max,
        });
        self.done.insert(one.shot.name.clone(), entry);
        let job: Map<_, _> = self.fields.iter().map(|(field, value)| ((*field).to_owned(), json!(value))).collect();
        let text = format!("{:#}\n", json!({ "job": job, "done": self.done }));
        write_whole(&self.path, text.as_bytes()).inspect_err(|_| drop(self.done.remove(&one.shot.name)))
    }

    /// After a failure: how to go on.
    pub(super) fn tell_how_to_go_on(&self, wanted: usize) {
        let (done, folder) = (self.done.len(), self.path.parent().unwrap_or(Path::new("")).display());
        if done > 0 {
            let told = format!("{done} of {wanted} pictures are in {folder}; the same with --resume renders the rest");
            tell("note", told);
        }
    }
}

/// Whether an entry knows a file of these contents.
fn told(entry: &Value, digest: &str) -> bool {
    entry["files"].as_array().is_some_and(|files| files.iter().any(|file| file == digest))
}
