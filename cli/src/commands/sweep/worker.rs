//! One configuration of a sweep in its own process, so that its peak memory is measured separately and
//! engines that need different libraries can be timed in turn.
//!
//! The worker writes a line of JSON once, `{"size": [width, height], …}`. Each line that it reads is the index of a target to render,
//! answered by `{"seconds": {stage: time}, "peak_memory_bytes": …}`, the first of a target also by its scores; it ends with its input.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdout, Command, Stdio};

use anyhow::{Context, Result, bail};
use liveview::layers::Layers;
use liveview_live::peak_memory;
use liveview_synthesizer::{LayerSpec, Plan, Score, Shot, Synthesizer, Targets};
use serde_json::{Value, json};

use super::report::Row;
use super::{Configuration, RowEngine, SweepArgs};
use crate::args::named;
use crate::console::{Output, path_text};
use crate::job::Job;

/// Runs a configuration, as the lines of standard input ask for; without a network from so many views.
pub(super) fn run(args: &SweepArgs, configuration: &Configuration, views: usize) -> Result<Output> {
    let model = match configuration.engine {
        RowEngine::Own => args.model.with_network(None),
        RowEngine::Other(engine) => args.model.with_network(Some(engine)),
        RowEngine::NoNetwork => args.model.no_network(views),
    };
    let mut job = Job::with_layers(args.scene.open()?, &model, Some(&configuration.layers))?;
    let held_out = named(job.synthesizer.scene(), &args.target)?;
    let targets = scaled(Targets::held_out(job.synthesizer.scene(), held_out), configuration.width)?;
    let shots = job.synthesizer.shots(targets)?;
    // Unreadable photos are reported before anything is timed.
    for shot in &shots {
        job.synthesizer.load(shot, &shots)?;
    }
    let sources = |shot: &Shot| json!(job.synthesizer.views().names(&shot.views));
    send_line(&json!({
        "size": shots.first().map(|shot| [shot.target.width(), shot.target.height()]), "engine": job.model.engine(),
        "model": job.model.path().map(path_text), "views": shots.iter().map(sources).collect::<Vec<_>>(),
    }))?;
    let weighting = job.model.weighting_stage();
    let mut known: Vec<Known> = shots.iter().map(|_| Known::default()).collect();
    for line in std::io::stdin().lock().lines() {
        let target: usize = line?.parse()?;
        send_line(&render(&mut job.synthesizer, weighting, &shots, target, &mut known[target])?)?;
    }
    Ok(Output { text: String::new(), json: Value::Null })
}

/// Renders a target; returns the answer.
fn render(
    synthesizer: &mut Synthesizer,
    weighting: &str,
    shots: &[Shot],
    target: usize,
    known: &mut Known,
) -> Result<Value> {
    let shot = &synthesizer.load(&shots[target], shots)?;
    let planned = match known.selected.take() {
        Some(layers) => Plan::known(layers),
        None => synthesizer.plan(shot)?,
    };
    let rendered = synthesizer.render_plan(shot, &planned, None)?;
    let seconds = json!({
        "depth": planned.search.as_secs_f64(), "select": planned.selection.as_secs_f64(),
        "warp": rendered.times.warp.as_secs_f64(), (weighting): rendered.times.network.as_secs_f64(),
        "composite": rendered.times.composite.as_secs_f64(),
    });
    // Before the score, which needs memory of its own.
    let mut answer = json!({ "seconds": seconds, "layers": planned.layers.len(), "peak_memory_bytes": peak_memory() });
    if let (false, Some(view)) = (std::mem::replace(&mut known.is_scored, true), shot.shot().truth) {
        let picture = rendered.picture().in_8_bits();
        // `--widths` makes pictures of another size.
        let truth = synthesizer.scene().load_image(view)?.resized(picture.width(), picture.height())?;
        let score = Score::of(&picture, &truth);
        (answer["psnr"], answer["ssim"]) = (json!(score.map(|s| s.psnr)), json!(score.map(|s| s.ssim)));
    }
    known.selected = Some(planned.layers).filter(|_| matches!(synthesizer.layers(), LayerSpec::Select { .. }));
    Ok(answer)
}

/// What is known of a target from its first render.
#[derive(Default)]
struct Known {
    /// The selected planes, which later renders use, as in the paper's video.
    selected: Option<Layers>,
    is_scored: bool,
}

/// Prints a line of JSON on standard output.
pub(crate) fn send_line(line: &Value) -> Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).context("standard output: cannot be written")
}

/// The targets scaled to a width in pixels.
fn scaled(mut targets: Targets, width: Option<usize>) -> Result<Targets> {
    let Some(width) = width else { return Ok(targets) };
    for target in &mut targets.list {
        let height = target.camera.height() as f64 * width as f64 / target.camera.width() as f64;
        target.camera = target.camera.with_size_scaled(width, (height.round() as usize).max(1))?;
    }
    Ok(targets)
}

/// A process that answers requests. Dropping it waits for its end.
pub(super) struct WorkerProcess {
    process: Child,
    from: BufReader<ChildStdout>,
    name: String,
}

impl WorkerProcess {
    /// Starts a command, and waits until it is ready. Returns also its first line, which describes it. `name` is for errors.
    pub(super) fn start(name: &str, command: &[OsString]) -> Result<(Self, Value)> {
        let (program, args) = command.split_first().context("expected a command")?;
        let mut command = Command::new(program);
        command.args(args).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut process = command.spawn().with_context(|| format!("{}: cannot be started", program.display()))?;
        let from = BufReader::new(process.stdout.take().expect("piped"));
        let mut worker = Self { process, from, name: name.to_owned() };
        let ready = worker.receive()?;
        Ok((worker, ready))
    }

    /// Has a target rendered, and waits for the answer.
    pub(super) fn ask(&mut self, target: usize) -> Result<Value> {
        let to = self.process.stdin.as_mut().expect("piped");
        let sent = writeln!(to, "{target}").and_then(|()| to.flush());
        sent.with_context(|| format!("{}: ended unexpectedly", self.name))?;
        self.receive()
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
    /// Renders so many targets once, and takes their mean score.
    pub(super) fn warm_up(&mut self, targets: usize) -> Result<()> {
        let mut scores = Vec::new();
        for target in 0..targets {
            let answer = self.worker.ask(target)?;
            scores.push(answer["psnr"].as_f64().zip(answer["ssim"].as_f64()));
            if target == 0 {
                let stage = if self.row.along_surface() { "depth" } else { "select" };
                self.row.once = answer["seconds"][stage].as_f64().unwrap_or(0.0);
                self.row.peak_memory_bytes = answer["peak_memory_bytes"].as_u64();
                self.row.count = answer["layers"].as_u64().unwrap_or(0) as usize;
            }
        }
        let scored: Option<Vec<(f64, f64)>> = scores.into_iter().collect();
        self.row.score = scored.map(|scores| {
            let mean = |of: fn(&(f64, f64)) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
            Score { psnr: mean(|score| score.0), ssim: mean(|score| score.1) }
        });
        Ok(())
    }

    /// Renders the first target again and records the times.
    pub(super) fn time(&mut self) -> Result<()> {
        let answer = self.worker.ask(0)?;
        let seconds = answer["seconds"].as_object().into_iter().flatten();
        let stages = seconds.map(|(stage, time)| (stage.clone(), time.as_f64().unwrap_or(f64::NAN)));
        self.row.runs.push(stages.collect());
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
