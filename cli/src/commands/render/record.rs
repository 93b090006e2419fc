//! The record of finished pictures, `liveview.jsonl` in their folder, for `render --resume`: a line of JSON for each. Lines are
//! only appended, so that any number of runs, at once or one after the other, may write to one folder.

use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use liveview_files::atomic::is_special;
use liveview_files::bounded;
use liveview_synthesizer::{Score, Shot};
use serde_json::{Value, json};

use super::summary::Rendered;
use crate::args::LayerArgs;
use crate::console::print_message;
use crate::job::Job;

/// The record's file name.
pub(super) const NAME: &str = "liveview.jsonl";

/// A digest of everything that the pictures of a job depend on: not the number of threads, the batch size, and where files are.
pub(super) fn job_digest(job: &Job, shots: &[Shot], layers: &LayerArgs, jpeg_quality: Option<u8>) -> Result<String> {
    let scene = job.synthesizer.scene();
    let first = &shots[0];
    let model = job.model.path().map(digest_of).transpose()?;
    let mut text = format!(
        "{} {model:?} {} {} {} {:?} {jpeg_quality:?}\n",
        env!("CARGO_PKG_VERSION"),
        job.model.engine(),
        job.synthesizer.renderer().alpha(),
        job.synthesizer.layers(),
        layers.photo_correction()
    );
    let mut views = BTreeSet::new();
    if job.synthesizer.uses_depth() {
        // The depth of a photo depends on its neighbours, and the depth range on all photos. Of the same range, planes are
        // others where it is given than where it is refined.
        views.extend((0..scene.views.len()).filter(|view| !first.held_out.contains(view)));
        let ranges: Vec<_> = views.iter().map(|&view: &usize| scene.views[view].depth_range).collect();
        text += &format!("{} {ranges:?}\n", first.refines_range);
    }
    for shot in shots {
        text += &format!("{} {:?} {:?} {:?} {:?}\n", shot.name, shot.target, shot.near, shot.far, shot.views);
        views.extend(&shot.views);
    }
    for view in views.into_iter().map(|view: usize| &scene.views[view]) {
        let photo = digest_of(view.image_path())?;
        text +=
            &format!("{} {photo} {:?} {:?} {:?}\n", view.name, view.camera, view.native_camera(), view.distortion());
    }
    Ok(digest(text.as_bytes()))
}

/// The digest of a file's contents.
pub(super) fn digest(bytes: &[u8]) -> String {
    format!("crc32 {:08x}", crc32fast::hash(bytes))
}

fn digest_of(path: &Path) -> Result<String> {
    let bytes = bounded::read_regular(path, bounded::MAX_BYTES);
    Ok(digest(&bytes.with_context(|| format!("{}: cannot be read", path.display()))?))
}

/// The record of a folder, for one job.
pub(super) struct Record {
    path: PathBuf,
    /// The digest of the job.
    job: String,
    /// The lines of the job's finished pictures, by name.
    done: HashMap<String, Value>,
    /// Open from the first new picture on.
    file: Option<File>,
}

impl Record {
    pub(super) fn new(folder: &Path, job: String) -> Self {
        Self { path: folder.join(NAME), job, done: HashMap::new(), file: None }
    }

    /// Keeps the pictures that an earlier run of the same job has finished, if their files are unchanged; `wanted` are the names
    /// and files of all pictures. Temporary files are not deleted, since another process may be writing them.
    pub(super) fn resume(&mut self, wanted: &[(&str, Vec<PathBuf>)]) -> Result<()> {
        let text = match bounded::read_regular(&self.path, bounded::MAX_JSON_BYTES) {
            Err(error) if error.kind() == ErrorKind::NotFound => Vec::new(),
            read => read.with_context(|| format!("--resume: {}: cannot be read", self.path.display()))?,
        };
        // A line that a killed run left incomplete is no JSON.
        let lines = bounded::without_byte_order_mark(&text).split(|&byte| byte == b'\n');
        let lines = lines.filter_map(|line| serde_json::from_slice::<Value>(line).ok());
        let (own, others): (Vec<_>, Vec<_>) = lines.partition(|line| line["job"] == *self.job);
        let named = |line: Value| Some((line["name"].as_str()?.to_owned(), line));
        let mut own: HashMap<_, _> = own.into_iter().filter_map(named).collect();
        for (name, files) in wanted {
            if let Some(file) = files.iter().find(|file| is_special(file)) {
                let file = file.display();
                bail!("--resume: {file}: not a regular file; expected a file of an earlier run, or none");
            }
            let Some((name, line)) = own.remove_entry(*name) else { continue };
            let listed = |digest: String| line["files"].as_array().is_some_and(|files| files.contains(&digest.into()));
            if files.iter().all(|file| digest_of(file).is_ok_and(listed)) {
                self.done.insert(name, line);
            }
        }
        let mut note = format!("{} of {} pictures are kept", self.done.len(), wanted.len());
        if !others.is_empty() {
            note += &format!("; {} lines of {} are of other jobs", others.len(), self.path.display());
        }
        print_message("note", note);
        Ok(())
    }

    /// The picture of a shot, if it is kept.
    pub(super) fn kept(&self, shot: &Shot, files: Vec<PathBuf>) -> Option<Rendered> {
        let line = self.done.get(&shot.name)?;
        let number = |key: &str| line[key].as_f64();
        let score = number("psnr").zip(number("ssim")).map(|(psnr, ssim)| Score { psnr, ssim });
        Some(Rendered {
            shot: shot.clone(),
            layers: line["layers"].as_u64()? as usize,
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
        let line = json!({
            "liveview": env!("CARGO_PKG_VERSION"), "job": self.job, "name": one.shot.name, "files": digests, "layers": one.layers,
            "psnr": one.score.map(|score| score.psnr), "ssim": one.score.map(|score| score.ssim), "psnr_covered": one.psnr_covered,
            "guessed_share": one.guessed_share, "uncovered_share": one.uncovered_share,
            "occluded_share": one.occluded_share, "disparity_max": one.disparity_max,
        });
        self.append(&line).map_err(|error| anyhow!("{}: cannot be written: {error}", self.path.display()))?;
        self.done.insert(one.shot.name.clone(), line);
        Ok(())
    }

    fn append(&mut self, line: &Value) -> io::Result<()> {
        let mut text = format!("{line}\n");
        let file = match &mut self.file {
            Some(file) => file,
            None => {
                let mut file = File::options().read(true).append(true).create(true).open(&self.path)?;
                let mut last = *b"\n";
                if file.seek(SeekFrom::End(-1)).is_ok() {
                    file.read_exact(&mut last)?;
                }
                // After a line that a killed run left incomplete.
                if last != *b"\n" {
                    text.insert(0, '\n');
                }
                self.file.insert(file)
            }
        };
        // By a single write, so that lines of several runs do not mix.
        file.write_all(text.as_bytes())
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
