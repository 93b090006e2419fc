//! Error against run time, for kinds and numbers of layers. Each configuration runs in a worker process; their repetitions are
//! interleaved.

#![allow(clippy::missing_errors_doc, reason = "errors name the option or the file, and what was expected of it")]

mod plot;
mod report;
mod worker;

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use liveview::ImageRgb;
use liveview::geometry::Size;
use liveview_files::unfinished::Unfinished;
use liveview_synthesizer::{LayerSpec, SceneViews, Targets, ViewAgreement};
use serde_json::{Value, json};

use report::Row;
pub use report::{SweepReport, quantile};
use worker::{Measured, WorkerProcess, scaled, text_of, write_job};
pub use worker::{Worker, send_line};

/// Engines of `python -m liveview_ref.competitors.worker`.
const REFERENCES: [&str; 4] = ["reference", "torch", "torch channels_last", "onnxruntime + kornia"];

/// What is reported while a sweep runs.
#[derive(Debug)]
pub enum Progress {
    /// So many more renders are to be done.
    More(usize),
    /// A configuration, by its name, is rendered next.
    Next(String),
    /// A render is done.
    Done,
}

/// Measures all configurations: views `held_out` of a scene against its photos. `model_file`: the model for layers of any kind, for
/// the reference implementations.
///
/// Each configuration runs in a process of its own: this program's own command line, with the option `--worker` and two numbers after
/// the command `sweep`; such a process calls [`Worker::run`].
pub fn run(
    settings: &SweepSettings,
    photos: &SceneViews,
    held_out: &[usize],
    model_file: &dyn Fn() -> Result<PathBuf>,
    report: &mut dyn FnMut(Progress),
) -> Result<SweepReport> {
    let folder = Unfinished::folder().context("a temporary folder for the workers' pictures cannot be created")?;
    let truths =
        held_out.iter().map(|&view| Ok(photos.scene().load_image(view)?)).collect::<Result<Vec<ImageRgb>>>()?;
    let (mut all, mut own, mut models) = (Vec::new(), Value::Null, Vec::new());
    let configurations: Vec<_> = configurations(settings).into_iter().enumerate().collect();
    for configurations in configurations.chunk_by(|(_, a), (_, b)| a.width == b.width) {
        let mut measured = Vec::new();
        for (number, Configuration { layers, engine, .. }) in configurations {
            let name = layers.to_string();
            let (worker, ready) = WorkerProcess::start(&name, &worker_command(*number, views(&own))?, None)?;
            let model = model(&ready);
            if !model.is_empty() && !models.contains(&model) {
                models.push(model);
            }
            if let RowEngine::Own = engine {
                own = ready.clone();
            }
            measured.push(Measured { worker, row: Row::new(&name, &ready, false, size(&ready)) });
        }
        if let Some(command) = &settings.reference {
            let reference = Reference { settings, command, model_file, photos, held_out, folder: folder.path() };
            measured.extend(reference.start(configurations[0].1.width, &own)?);
        }
        report(Progress::More(measured.len() * (settings.repetitions + 1)));
        for one in &mut measured {
            report(Progress::Next(one.row.name()));
            one.warm_up(&truths, folder.path())?;
            report(Progress::Done);
        }
        all.extend(measured);
    }
    for _ in 0..settings.repetitions {
        for one in &mut all {
            report(Progress::Next(one.row.name()));
            one.time()?;
            report(Progress::Done);
        }
    }
    Ok(SweepReport {
        scene: settings.scene.clone(),
        targets: settings.targets.clone(),
        views: views(&own),
        model: if models.is_empty() { "none".into() } else { models.join(", ") },
        threads: settings.threads,
        batch: settings.batch,
        cpu: cpu(),
        rows: all.into_iter().map(Measured::finish).collect(),
    })
}

/// The size of the first target, from a worker's first line.
fn size(ready: &Value) -> Size {
    let side = |index: usize| ready["size"][index].as_u64().unwrap_or(0) as usize;
    Size::new(side(0), side(1))
}

/// The number of views of the model, from a worker's first line.
fn views(ready: &Value) -> usize {
    ready["views"][0].as_array().map_or(0, Vec::len)
}

/// The model file's name, from a worker's first line; empty without a network.
fn model(ready: &Value) -> String {
    let path = Path::new(ready["model"].as_str().unwrap_or_default());
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The command line of a worker: that of this process, and which configuration it runs.
fn worker_command(number: usize, views: usize) -> Result<Vec<OsString>> {
    let mut command = vec![std::env::current_exe()?.into_os_string()];
    command.extend(std::env::args_os().skip(1));
    let at = command.iter().position(|word| word == "sweep").context("expected the command sweep")? + 1;
    let worker = ["--worker".into(), number.to_string().into(), views.to_string().into()];
    command.splice(at..at, worker);
    Ok(command)
}

/// The reference implementations.
struct Reference<'a> {
    settings: &'a SweepSettings,
    /// Without quotes.
    command: &'a str,
    model_file: &'a dyn Fn() -> Result<PathBuf>,
    photos: &'a SceneViews,
    held_out: &'a [usize],
    /// For their jobs.
    folder: &'a Path,
}

impl Reference<'_> {
    /// Starts all of them, on the most planes; `own`: the first line of the worker on the engine of the options.
    fn start(&self, width: Option<usize>, own: &Value) -> Result<Vec<Measured>> {
        let Self { settings, command, model_file, photos, held_out, folder } = *self;
        let planes = settings.layers.iter().filter_map(|layers| match layers {
            LayerSpec::Planes(count) => Some(*count),
            _ => None,
        });
        let Some(planes) = planes.max() else { bail!("--reference: expected planes among --layers, to measure it on") };
        let size = size(own);
        let file = folder.join(format!("job_{}.npz", size.width));
        let targets = scaled(Targets::held_out(photos.scene(), held_out.to_vec()), width)?;
        let shot = photos.shots(targets, views(own), 0, None)?.remove(0);
        write_job(&file, photos, &shot, planes)?;
        let model = model_file()?;
        let weights = model.with_extension("pt");
        let words: Vec<OsString> = command.split_whitespace().map(OsString::from).collect();
        let start = |engine: &str| {
            let weights = weights.is_file().then(|| weights.display().to_string());
            let job = json!({
                "job": text_of(&file)?, "model": text_of(&model)?, "weights": weights, "engine": engine,
                "threads": settings.threads, "batch": settings.batch,
            });
            let (worker, ready) = WorkerProcess::start(engine, &words, Some(&job))?;
            let row = Row { count: planes, ..Row::new(&format!("planes:{planes}"), &ready, true, size) };
            Ok(Measured { worker, row })
        };
        REFERENCES.into_iter().map(start).collect()
    }
}

/// The name of the processor, where the system reports it (Linux), and the widest vector instructions, which decide how fast networks run.
fn cpu() -> String {
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let name = name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned());
    vectors().map_or_else(|| name.clone(), |vectors| format!("{name} ({vectors})"))
}

#[cfg(target_arch = "x86_64")]
fn vectors() -> Option<&'static str> {
    use std::arch::is_x86_feature_detected as has;
    if has!("avx512f") {
        return Some("AVX-512");
    }
    has!("avx2").then_some("AVX2")
}

#[cfg(not(target_arch = "x86_64"))]
fn vectors() -> Option<&'static str> {
    None
}

/// Layers measured without a network: the same single layer as with one, and the default.
const WITHOUT_NETWORK: [LayerSpec; 2] = [LayerSpec::Surface(1), ViewAgreement::LAYERS];

/// What is measured, and how.
#[derive(Debug)]
pub struct SweepSettings {
    /// The scene as it was given.
    pub scene: String,
    /// Views to render, by name, all held out.
    pub targets: Vec<String>,
    /// Layers to measure.
    pub layers: Vec<LayerSpec>,
    /// Widths of the picture; none: the photo's.
    pub widths: Vec<usize>,
    /// Number of further engines, for surface and guided layers.
    pub engines: usize,
    /// Whether no network is used at all.
    pub without_network: bool,
    /// Timed renders of each configuration.
    pub repetitions: usize,
    /// Command of the reference implementations.
    pub reference: Option<String>,
    /// Number of threads.
    pub threads: usize,
    /// Layers per run of the network.
    pub batch: usize,
}

/// The engine of a row.
#[derive(Debug, Clone, Copy)]
pub enum RowEngine {
    /// That of the options.
    Own,
    /// One of the further engines, by its index.
    Other(usize),
    /// None: views are weighted by their agreement.
    NoNetwork,
}

/// What a row measures.
#[derive(Debug)]
pub struct Configuration {
    /// Of the target, pixels; `None`: the photo's.
    pub width: Option<usize>,
    /// The layers.
    pub layers: LayerSpec,
    /// The engine.
    pub engine: RowEngine,
}

/// The configurations of all rows, width by width; of each those on the engine of the options first.
pub fn configurations(settings: &SweepSettings) -> Vec<Configuration> {
    let along_surface = |layers: &&LayerSpec| matches!(layers, LayerSpec::Surface(_));
    let light =
        settings.layers.iter().filter(|layers| along_surface(layers) || matches!(layers, LayerSpec::Guided { .. }));
    let others = (0..settings.engines)
        .flat_map(|engine| light.clone().map(move |layers| (layers.clone(), RowEngine::Other(engine))));
    let own = settings.layers.iter().map(|layers| (layers.clone(), RowEngine::Own));
    let with_surface = settings.layers.iter().any(|layers| along_surface(&layers));
    let without_network = (with_surface && !settings.without_network).then_some(WITHOUT_NETWORK);
    let without_network = without_network.into_iter().flatten().map(|layers| (layers, RowEngine::NoNetwork));
    let rows: Vec<_> = own.chain(without_network).chain(others).collect();
    let widths =
        if settings.widths.is_empty() { vec![None] } else { settings.widths.iter().copied().map(Some).collect() };
    let of_width = |width: Option<usize>| {
        rows.iter().cloned().map(move |(layers, engine)| Configuration { width, layers, engine })
    };
    widths.into_iter().flat_map(of_width).collect()
}
