//! Worker processes that answer requests in lines of JSON, those of a sweep and the Python implementations; what they measure.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};

use anyhow::{Context, Error, Result, anyhow, bail};
use liveview::layers::uniform_disparities;
use liveview::{Camera, ImageRgb};
use liveview_files::atomic::AtomicFile;
use liveview_synthesizer::{SceneViews, Score, Shot};
use ndarray::{Array1, Array2, Array3};
use ndarray_npy::{NpzWriter, WriteNpzError};
use serde_json::{Value, json};

use crate::report::Row;

/// A path as text for a worker; JSON holds only UTF-8.
pub(super) fn text_of(path: &Path) -> Result<&str> {
    path.to_str().with_context(|| format!("{}: cannot be sent to a worker; expected a path in UTF-8", path.display()))
}

/// A process that answers requests. Dropping it waits for its end.
pub(super) struct WorkerProcess {
    process: Child,
    from: BufReader<ChildStdout>,
    name: String,
}

impl WorkerProcess {
    /// Starts a command, sends it its job if there is one, and waits until it is ready. Returns also its first line, which describes
    /// it. `name` is for errors.
    pub(super) fn start(name: &str, command: &[OsString], job: Option<&Value>) -> Result<(Self, Value)> {
        let (program, args) = command.split_first().context("expected a command")?;
        let mut command = Command::new(program);
        command.args(args).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut process = command.spawn().with_context(|| format!("{}: cannot be started", program.display()))?;
        let from = BufReader::new(process.stdout.take().expect("piped"));
        let mut worker = Self { process, from, name: name.to_owned() };
        if let Some(job) = job {
            worker.send(job)?;
        }
        let ready = worker.receive()?;
        Ok((worker, ready))
    }

    /// Sends a request and waits for the answer.
    pub(super) fn ask(&mut self, line: &Value) -> Result<Value> {
        self.send(line)?;
        self.receive()
    }

    fn send(&mut self, line: &Value) -> Result<()> {
        let to = self.process.stdin.as_mut().expect("piped");
        let sent = writeln!(to, "{line}").and_then(|()| to.flush());
        sent.with_context(|| format!("{}: ended unexpectedly", self.name))
    }

    fn receive(&mut self) -> Result<Value> {
        let mut line = String::new();
        if self.from.read_line(&mut line)? == 0 {
            bail!("{}: ended unexpectedly", self.name);
        }
        let answer: Value = serde_json::from_str(&line)
            .with_context(|| format!("{}: answered {:?}; expected a line of JSON", self.name, line.trim()))?;
        match answer["error"].as_str() {
            Some(error) => bail!("{}: {error}", self.name),
            None => Ok(answer),
        }
    }
}

impl Drop for WorkerProcess {
    /// Waits, which closes the process's input and so ends it; if waiting fails, kills it.
    fn drop(&mut self) {
        if self.process.wait().is_err() {
            let _ = self.process.kill();
        }
    }
}

/// A worker, with its measurements so far.
pub(super) struct Measured {
    pub(super) worker: WorkerProcess,
    pub(super) row: Row,
}

impl Measured {
    /// Renders every target once and scores the pictures against the photos; a reference implementation renders only the
    /// first.
    pub(super) fn warm_up(&mut self, truths: &[ImageRgb], folder: &Path) -> Result<()> {
        let truths = if self.row.reference { &truths[..1] } else { truths };
        let mut scores = Vec::new();
        for (target, truth) in truths.iter().enumerate() {
            let frame = folder.join("frame.npy");
            let answer = self.worker.ask(&json!({ "run": true, "target": target, "frame": text_of(&frame)? }))?;
            let pixels: Array3<f32> = ndarray_npy::read_npy(&frame).context("a worker's picture cannot be read")?;
            let (height, width, _) = pixels.dim();
            let picture = ImageRgb::new(width, height, pixels.iter().copied().collect())?;
            scores.push(Score::of(&picture, truth));
            if target == 0 {
                let stage = if self.row.along_surface() { "depth" } else { "select" };
                self.row.once = answer["seconds"][stage].as_f64().unwrap_or(0.0);
            }
            if let Some(count) = answer["layers"].as_u64() {
                self.row.count = count as usize;
            }
        }
        let scored: Option<Vec<Score>> = scores.into_iter().collect();
        let mean = |scores: Vec<Score>| {
            let mean_of = |of: fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
            Score { psnr: mean_of(|score| score.psnr), ssim: mean_of(|score| score.ssim) }
        };
        self.row.score = scored.map(mean).filter(|score| score.psnr.is_finite() && score.ssim.is_finite());
        Ok(())
    }

    /// Renders the first target again and records the times.
    pub(super) fn time(&mut self) -> Result<()> {
        let answer = self.worker.ask(&json!({ "run": true, "target": 0 }))?;
        let Some(seconds) = answer["seconds"].as_object() else {
            bail!("{}: the answer has no times; expected `seconds`", self.row.engine)
        };
        let stages = seconds.iter().map(|(stage, time)| (stage.clone(), time.as_f64().unwrap_or(f64::NAN)));
        self.row.runs.push(stages.collect());
        self.row.peak_memory_bytes = answer["peak_memory_bytes"].as_u64();
        Ok(())
    }

    /// The row, with all its measurements.
    pub(super) fn finish(mut self) -> Row {
        if self.row.along_surface() {
            // Each picture searches its surface; what the first takes longer is the depth of the photos.
            let surface = self.row.stages().into_iter().find_map(|(stage, time)| (stage == "depth").then_some(time));
            self.row.once = (self.row.once - surface.unwrap_or(0.0)).max(0.0);
        }
        self.row
    }
}

type Arrays = NpzWriter<AtomicFile>;

/// Writes the photos that a shot is rendered from, their cameras, the target camera and uniform planes.
pub(super) fn write_job(path: &Path, views: &SceneViews, shot: &Shot, planes: usize) -> Result<()> {
    let unwritten = |error: WriteNpzError| unwritten(path, error);
    let mut arrays = NpzWriter::new(AtomicFile::create(path).map_err(|error| self::unwritten(path, error))?);
    for (index, &view) in shot.views.iter().enumerate() {
        add_camera(&mut arrays, &format!("view{index}"), &views.scene().views[view].camera).map_err(unwritten)?;
        let photo = views.scene().load_image(view)?;
        arrays.add_array(format!("view{index}.image"), &photo.as_array()).map_err(unwritten)?;
    }
    add_camera(&mut arrays, "target", &shot.target).map_err(unwritten)?;
    let size = Array1::from_vec(vec![shot.target.width() as i64, shot.target.height() as i64]);
    arrays.add_array("target.size", &size).map_err(unwritten)?;
    let disparities = Array1::from_vec(uniform_disparities(shot.near, shot.far, planes)?);
    arrays.add_array("disparities", &disparities).map_err(unwritten)?;
    arrays.finish().map_err(unwritten)?.finish().map_err(|error| self::unwritten(path, error))
}

fn add_camera(arrays: &mut Arrays, name: &str, camera: &Camera) -> Result<(), WriteNpzError> {
    let matrix = |m: glam::DMat3| Array2::from_shape_fn((3, 3), |(row, column)| m.row(row)[column]);
    arrays.add_array(format!("{name}.k"), &matrix(camera.k()))?;
    arrays.add_array(format!("{name}.rotation"), &matrix(camera.rotation()))?;
    arrays.add_array(format!("{name}.translation"), &Array1::from_vec(camera.translation().to_array().to_vec()))
}

/// The error of a file that cannot be written, with only the root cause.
pub(super) fn unwritten(path: &Path, error: impl Into<Error>) -> Error {
    anyhow!("{}: cannot be written: {}", path.display(), error.into().root_cause())
}
