//! One configuration of `liveview sweep` in its own process, so that its peak memory is measured separately and
//! engines that need different libraries can be timed in turn.
//!
//! The protocol is lines of JSON: the worker writes `{"ready": true, "size": [width, height], …}` once; each request `{"run": true,
//! "target": 0, "frame": "a.npy"}` is one render, answered by `{"seconds": {stage: time}, "peak_memory_bytes": …}`; the worker ends
//! with its input. The picture is saved to `frame`, if given. The Python worker (`liveview_ref.competitors.worker`) has the same
//! protocol.

use std::io::BufRead;
use std::path::Path;

use anyhow::{Result, anyhow};
use liveview::fs::atomic::AtomicFile;
use liveview::layers::Layers;
use liveview::{ImageRgb, LayerSpec, Plan, Shot, Targets};
use liveview_common::args::targets::named;
use liveview_common::console::{Output, path_text, send_line};
use liveview_common::job::Job;
use liveview_common::measure::peak_memory;
use ndarray_npy::WriteNpyExt;
use serde_json::{Value, json};

use super::configuration::{Configuration, RowEngine, SweepArgs};
use super::job_file::unwritten;

/// A worker's configuration, and its state between requests.
struct Renders {
    job: Job,
    shots: Vec<Shot>,
    /// Planes selected at a target's first render are used for later ones, as in the paper's video.
    selected: Vec<Option<Layers>>,
}

/// Runs a configuration; without a network from so many views.
pub(super) fn run(args: &SweepArgs, configuration: &Configuration, views: usize) -> Result<Output> {
    let model = match configuration.engine {
        RowEngine::Own => args.model.with_network(None),
        RowEngine::Other(engine) => args.model.with_network(Some(engine)),
        RowEngine::NoNetwork => args.model.no_network(views),
    };
    let mut job = Job::with_layers(args.scene.open()?, &model, Some(&configuration.layers))?;
    let views = named(job.scene(), &args.target)?;
    let targets = scaled(Targets::held_out(job.scene(), views), configuration.width)?;
    let shots = job.synthesizer.shots(targets)?;
    // Unreadable photos are reported before anything is timed.
    for shot in &shots {
        job.synthesizer.load(shot, &shots)?;
    }
    let sources = |shot: &Shot| job.views().names(&shot.views).into_iter().map(str::to_owned).collect::<Vec<_>>();
    send_line(&json!({
        "ready": true, "size": shots.first().map(|shot| [shot.target.width(), shot.target.height()]),
        "engine": job.model.engine(), "layers": job.layers().to_string(), "model": job.model.path().map(path_text),
        "views": shots.iter().map(sources).collect::<Vec<_>>(),
    }))?;
    let mut worker = Renders { selected: shots.iter().map(|_| None).collect(), job, shots };
    for line in std::io::stdin().lock().lines() {
        let request: Value = serde_json::from_str(&line?)?;
        if request["run"] != true {
            break;
        }
        let answer = worker.render(request["target"].as_u64().unwrap_or(0) as usize, request["frame"].as_str())?;
        send_line(&answer)?;
    }
    Ok(Output { text: String::new(), json: Value::Null })
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

impl Renders {
    /// Renders a target, and saves the picture to `frame` if given; returns the answer.
    fn render(&mut self, target: usize, frame: Option<&str>) -> Result<Value> {
        let shot = self.shots.get(target).ok_or_else(|| anyhow!("target {target}: there are {}", self.shots.len()))?;
        let shot = &self.job.synthesizer.load(shot, &self.shots)?;
        let planned = match self.selected[target].take() {
            Some(layers) => Plan::known(layers),
            None => self.job.plan(shot)?,
        };
        let rendered = self.job.render(shot, &planned)?;
        if let Some(path) = frame {
            save(path.as_ref(), &rendered.picture)?;
        }
        let weighting = self.job.model.weighting_stage();
        let seconds = json!({
            "depth": planned.search.as_secs_f64(), "select": planned.selection.as_secs_f64(),
            "warp": rendered.times.warp.as_secs_f64(), (weighting): rendered.times.network.as_secs_f64(),
            "composite": rendered.times.composite.as_secs_f64(),
        });
        let layers = planned.layers.len();
        self.selected[target] = Some(planned.layers).filter(|_| matches!(self.job.layers(), LayerSpec::Select { .. }));
        Ok(json!({ "seconds": seconds, "layers": layers, "peak_memory_bytes": peak_memory() }))
    }
}

/// A picture as float32 `[height, width, 3]`.
fn save(path: &Path, picture: &ImageRgb) -> Result<()> {
    let mut file = AtomicFile::create(path).map_err(|error| unwritten(path, error))?;
    picture.as_array().write_npy(&mut file).map_err(|error| unwritten(path, error))?;
    file.finish().map_err(|error| unwritten(path, error))
}
