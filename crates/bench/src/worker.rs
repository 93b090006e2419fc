//! One configuration of a sweep in its own process, so that its peak memory is measured separately and
//! engines that need different libraries can be timed in turn.
//!
//! The protocol is lines of JSON: the worker writes `{"ready": true, "size": [width, height], …}` once; each request `{"run": true,
//! "target": 0, "frame": "a.npy"}` is one render, answered by `{"seconds": {stage: time}, "peak_memory_bytes": …}`; the worker ends
//! with its input. The picture is saved to `frame`, if given. The Python worker (`liveview_ref.competitors.worker`) has the same
//! protocol.

use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use liveview::ImageRgb;
use liveview::layers::Layers;
use liveview_files::atomic::AtomicFile;
use liveview_synthesizer::{LayerSpec, Plan, Shot, Synthesizer, Targets};
use ndarray_npy::WriteNpyExt;
use serde_json::{Value, json};

use crate::processes::unwritten;

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
            save(path.as_ref(), rendered.raw())?;
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
    let mut file = AtomicFile::create(path).map_err(|error| unwritten(path, error))?;
    picture.as_array().write_npy(&mut file).map_err(|error| unwritten(path, error))?;
    file.finish().map_err(|error| unwritten(path, error))
}
