//! One configuration of a sweep in its own process, so that its peak memory is measured separately and
//! engines that need different libraries can be timed in turn.
//!
//! The protocol is lines of JSON: the worker writes `{"ready": true, "size": [width, height], …}` once; each request `{"run": true,
//! "target": 0, "frame": "a.npy"}` is one render, answered by `{"seconds": {stage: time}, "peak_memory_bytes": …}`; the worker ends
//! with its input. The picture is saved to `frame`, if given. The Python worker (`liveview_ref.competitors.worker`) has the same
//! protocol.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

use anyhow::{Context, Error, Result, anyhow, bail};
use liveview::layers::{Layers, uniform_disparities};
use liveview::{Camera, ImageRgb};
use liveview_files::{atomic, npy};
use liveview_synthesizer::{LayerSpec, Plan, SceneViews, Score, Shot, Synthesizer, Targets};
use ndarray::{Array3, aview1, aview2};
use serde_json::{Value, json};

use crate::report::Row;

/// The configuration of a worker.
#[derive(Debug)]
pub struct Worker {
    /// Renders it.
    pub synthesizer: Synthesizer,
    /// Execution provider and precision.
    pub engine: String,
    /// The model file.
    pub model: Option<PathBuf>,
    /// The name of the stage that computes opacities and view weights.
    pub weighting: &'static str,
    /// Peak memory of the process in bytes, where it is known.
    pub peak_memory: fn() -> Option<u64>,
}

impl Worker {
    /// Renders the views `held_out`, scaled to a width in pixels, as the lines of standard input ask for.
    pub fn run(mut self, held_out: Vec<usize>, width: Option<usize>) -> Result<()> {
        let targets = scaled(Targets::held_out(self.synthesizer.scene(), held_out), width)?;
        let shots = self.synthesizer.shots(targets)?;
        // Unreadable photos are reported before anything is timed.
        for shot in &shots {
            self.synthesizer.load(shot, &shots)?;
        }
        let views = self.synthesizer.views();
        let sources = |shot: &Shot| views.names(&shot.views).into_iter().map(str::to_owned).collect::<Vec<_>>();
        send_line(&json!({
            "ready": true, "size": shots.first().map(|shot| [shot.target.width(), shot.target.height()]),
            "engine": self.engine, "layers": self.synthesizer.layers().to_string(),
            "model": self.model.as_ref().map(|model| model.display().to_string()),
            "views": shots.iter().map(sources).collect::<Vec<_>>(),
        }))?;
        // Planes selected at a target's first render are used for later ones, as in the paper's video.
        let mut selected: Vec<Option<Layers>> = shots.iter().map(|_| None).collect();
        for line in std::io::stdin().lock().lines() {
            let request: Value = serde_json::from_str(&line?)?;
            if request["run"] != true {
                break;
            }
            let target = request["target"].as_u64().unwrap_or(0) as usize;
            let known =
                selected.get_mut(target).with_context(|| format!("target {target}: there are {}", shots.len()))?;
            send_line(&self.render(&shots, target, known, request["frame"].as_str())?)?;
        }
        Ok(())
    }

    /// Renders a target, and saves the picture to `frame` if given; returns the answer.
    fn render(
        &mut self,
        shots: &[Shot],
        target: usize,
        selected: &mut Option<Layers>,
        frame: Option<&str>,
    ) -> Result<Value> {
        let shot = &self.synthesizer.load(&shots[target], shots)?;
        let planned = match selected.take() {
            Some(layers) => Plan::known(layers),
            None => self.synthesizer.plan(shot)?,
        };
        let rendered = self.synthesizer.render_plan(shot, &planned, None)?;
        if let Some(path) = frame {
            save(path.as_ref(), &rendered.picture())?;
        }
        let seconds = json!({
            "depth": planned.search.as_secs_f64(), "select": planned.selection.as_secs_f64(),
            "warp": rendered.times.warp.as_secs_f64(), (self.weighting): rendered.times.network.as_secs_f64(),
            "composite": rendered.times.composite.as_secs_f64(),
        });
        let layers = planned.layers.len();
        *selected = Some(planned.layers).filter(|_| matches!(self.synthesizer.layers(), LayerSpec::Select { .. }));
        Ok(json!({ "seconds": seconds, "layers": layers, "peak_memory_bytes": (self.peak_memory)() }))
    }
}

/// Prints a line of JSON on standard output.
pub fn send_line(line: &Value) -> Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).context("standard output: cannot be written")
}

/// The targets scaled to a width in pixels.
pub(super) fn scaled(mut targets: Targets, width: Option<usize>) -> Result<Targets> {
    let Some(width) = width else { return Ok(targets) };
    for target in &mut targets.list {
        let height = target.camera.height() as f64 * width as f64 / target.camera.width() as f64;
        target.camera = target.camera.with_size_scaled(width, (height.round() as usize).max(1))?;
    }
    Ok(targets)
}

/// A picture as float32 `[height, width, 3]`.
fn save(path: &Path, picture: &ImageRgb) -> Result<()> {
    atomic::write(path, &npy::bytes(&picture.as_array())).map_err(|error| unwritten(path, error))
}

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
            let bytes = std::fs::read(&frame).context("a worker's picture cannot be read")?;
            let pixels: Array3<f32> = npy::read(&bytes).map_err(|what| anyhow!("a worker's picture: {what}"))?;
            let picture = ImageRgb::from_array(pixels.view())?.in_8_bits();
            // `--widths` makes pictures of another size.
            let truth = truth.clone().resized(picture.width(), picture.height())?;
            scores.push(Score::of(&picture, &truth));
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

/// Writes the photos that a shot is rendered from, their cameras, the target camera and uniform planes.
pub(super) fn write_job(path: &Path, views: &SceneViews, shot: &Shot, planes: usize) -> Result<()> {
    let mut arrays = camera("target", &shot.target);
    for (index, &view) in shot.views.iter().enumerate() {
        arrays.extend(camera(&format!("view{index}"), &views.scene().views[view].camera));
        let photo = views.scene().load_image(view)?;
        arrays.push((format!("view{index}.image"), npy::bytes(&photo.as_array())));
    }
    let size = [shot.target.width() as i64, shot.target.height() as i64];
    arrays.push(("target.size".to_owned(), npy::bytes(&aview1(&size))));
    let disparities = uniform_disparities(shot.near, shot.far, planes)?;
    arrays.push(("disparities".to_owned(), npy::bytes(&aview1(&disparities))));
    let bytes = npy::npz(arrays).map_err(|error| unwritten(path, error))?;
    atomic::write(path, &bytes).map_err(|error| unwritten(path, error))
}

/// The arrays of a camera.
fn camera(name: &str, camera: &Camera) -> Vec<(String, Vec<u8>)> {
    let matrix = |m: glam::DMat3| npy::bytes(&aview2(&m.transpose().to_cols_array_2d()));
    vec![
        (format!("{name}.k"), matrix(camera.k())),
        (format!("{name}.rotation"), matrix(camera.rotation())),
        (format!("{name}.translation"), npy::bytes(&aview1(&camera.translation().to_array()))),
    ]
}

/// The error of a file that cannot be written, with only the root cause.
pub(super) fn unwritten(path: &Path, error: impl Into<Error>) -> Error {
    anyhow!("{}: cannot be written: {}", path.display(), error.into().root_cause())
}
