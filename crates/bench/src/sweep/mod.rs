//! `liveview sweep`: error against run time. Each configuration runs in a worker process; their repetitions are interleaved.

mod cpu;
mod markdown;
mod measured;
mod plot;
mod rows;
mod svg;
mod worker;

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use cpu::cpu;
use liveview::geometry::Size;
use liveview::layers::uniform_disparities;
use liveview::network::ViewAgreement;
use liveview::{LayerSpec, SceneViews, Shot, Targets};
use liveview_common::args::model::ModelArgs;
use liveview_common::args::model_names::ProviderChoice;
use liveview_common::args::numbers;
use liveview_common::args::output::{refuse_stdout, write_atomically};
use liveview_common::args::scene::SceneArgs;
use liveview_common::args::targets::named;
use liveview_common::console::{Output, path_text, print_message, print_notes, progress};
use liveview_common::outputs::OutputPlan;
use measured::Measured;
use ndarray::Array1;
use rows::{Row, SweepReport};
use serde_json::{Value, json};
use worker::scaled;

use crate::npz::Arrays;
use crate::worker_process::{WorkerProcess, text_of, words};

const EXAMPLES: &str = "\
Examples:
  liveview sweep scene --target IMG_7.jpg -o report/
  liveview sweep scene --target IMG_7.jpg --layers guided:2,guided:4,planes:64 --repetitions 9 -o report/
  Time against size:
    liveview sweep scene --target IMG_7.jpg --layers guided:4,planes:16 --widths 500,1000,2000 -o scaling/";

/// Kinds and numbers of layers.
const LAYERS: &str = "surface:1,surface:2,guided:1,guided:2,guided:3,guided:4,guided:6,guided:8,guided:12,select:8,select:16,\
                      select:32,planes:8,planes:16,planes:32,planes:64";

/// Layers measured without a network: the same single layer as with one, and the default.
const WITHOUT_NETWORK: [LayerSpec; 2] = [LayerSpec::Surface(1), ViewAgreement::LAYERS];

/// Engines of `python -m liveview_ref.competitors.worker`.
const REFERENCES: [&str; 5] = ["reference", "torch", "torch channels_last", "onnxruntime + kornia", "one graph"];

/// The files written.
const FILES: [&str; 3] = ["sweep.json", "sweep.md", "sweep.svg"];

/// Options of `liveview sweep`.
#[derive(Debug, Args)]
#[command(after_help = "--help also lists the advanced options.", after_long_help = EXAMPLES)]
pub struct SweepArgs {
    /// Views to render, by name, all held out: scores are their means, times those of the first
    #[arg(long, value_name = "NAME,…", required = true)]
    target: Vec<String>,
    /// Layers to measure, separated by commas; surface layers also without a network [default: several
    /// of each kind]
    #[arg(long, value_name = "LIST", default_value = LAYERS, hide_default_value = true, value_delimiter = ',')]
    layers: Vec<LayerSpec>,
    /// Widths of the picture, separated by commas, to measure time against size [default: the photo's]
    #[arg(long, value_name = "PIXELS", value_delimiter = ',', value_parser = numbers::count)]
    widths: Vec<usize>,
    /// Further engines for surface and guided layers, with precisions, such as "cpu int8,openvino int8"
    #[arg(long, value_name = "LIST", value_delimiter = ',', conflicts_with = "network")]
    engines: Vec<ProviderChoice>,
    /// Timed renders of each configuration, after one to warm up
    #[arg(long, value_name = "N", default_value = "5", value_parser = numbers::count)]
    repetitions: usize,
    /// Command of the reference implementations: "python -m liveview_ref.competitors.worker"
    #[arg(long, value_name = "COMMAND", conflicts_with = "network")]
    reference: Option<String>,
    #[command(flatten)]
    model: ModelArgs,
    /// Folder for sweep.json, sweep.md and sweep.svg
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Run one configuration, controlled by lines of JSON: its number, and that of views without a network
    #[arg(long, num_args = 2, value_names = ["N", "V"], hide = true)]
    worker: Option<Vec<usize>>,
    #[command(flatten)]
    scene: SceneArgs,
}

impl SweepArgs {
    /// Whether it is the process of one configuration: its errors go to the sweep that started it.
    pub fn is_worker(&self) -> bool {
        self.worker.is_some()
    }
}

/// Runs `liveview sweep`.
pub fn run(args: &SweepArgs) -> Result<Output> {
    if let Some(&[number, views]) = args.worker.as_deref() {
        let all = configurations(args);
        let configuration = all.get(number).with_context(|| format!("--worker {number}: there are {}", all.len()))?;
        return worker::run(args, configuration, views);
    }
    let folder = tempfile::tempdir().context("a temporary folder for the workers' pictures cannot be created")?;
    let photos = args.scene.open()?;
    print_notes(&photos.scene().notes);
    refuse_stdout("-o", &args.output)?;
    let mut output_plan = OutputPlan::new(photos.scene());
    FILES.iter().try_for_each(|name| output_plan.named_file("-o", &args.output.join(name)))?;
    output_plan.prepare()?;
    let held_out = named(photos.scene(), &args.target)?;
    let truths = held_out.iter().map(|&view| Ok(photos.scene().load_image(view)?)).collect::<Result<Vec<_>>>()?;
    let bar = progress("renders")?;
    let (mut all, mut own, mut models) = (Vec::new(), Value::Null, Vec::new());
    let configurations: Vec<_> = configurations(args).into_iter().enumerate().collect();
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
            measured.push(Measured::new(worker, Row::new(&name, &ready, false, size(&ready))));
        }
        if let Some(command) = &args.reference {
            measured.extend(references(args, command, &photos, configurations[0].1.width, &own, folder.path())?);
        }
        bar.inc_length((measured.len() * (args.repetitions + 1)) as u64);
        for one in &mut measured {
            bar.set_message(one.row.name());
            one.warm_up(truths.len(), folder.path())?;
            one.score(&truths);
            bar.inc(1);
        }
        all.extend(measured);
    }
    for _ in 0..args.repetitions {
        for one in &mut all {
            bar.set_message(one.row.name());
            one.time()?;
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    let sweep = SweepReport {
        scene: args.scene.folder().display().to_string(),
        targets: args.target.clone(),
        views: views(&own),
        model: if models.is_empty() { "none".into() } else { models.join(", ") },
        threads: args.model.threads(),
        batch: args.model.batch,
        cpu: cpu(),
        rows: all.into_iter().map(Measured::finish).collect(),
    };
    if sweep.noisy() {
        print_message(
            "warning",
            "the times of the repetitions differ widely: the machine is too busy for reliable times",
        );
    }
    let (text, json) = (markdown::markdown(&sweep), sweep.json());
    for (name, contents) in FILES.into_iter().zip([format!("{json:#}\n"), text.clone(), plot::plot(&sweep)]) {
        write_atomically(&args.output.join(name), contents.as_bytes())?;
    }
    Ok(Output { text, json })
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

/// The engine of a row.
#[derive(Clone, Copy)]
enum RowEngine {
    /// That of the options.
    Own,
    Other(ProviderChoice),
    NoNetwork,
}

/// What a row measures.
struct Configuration {
    /// Of the target, pixels; `None`: the photo's.
    width: Option<usize>,
    layers: LayerSpec,
    engine: RowEngine,
}

/// The configurations of all rows, width by width; of each those on the engine of the options first.
fn configurations(args: &SweepArgs) -> Vec<Configuration> {
    let along_surface = |layers: &&LayerSpec| matches!(layers, LayerSpec::Surface(_));
    let light = args.layers.iter().filter(|layers| along_surface(layers) || matches!(layers, LayerSpec::Guided { .. }));
    let others = args
        .engines
        .iter()
        .flat_map(|&engine| light.clone().map(move |layers| (layers.clone(), RowEngine::Other(engine))));
    let own = args.layers.iter().map(|layers| (layers.clone(), RowEngine::Own));
    let with_surface = args.layers.iter().any(|layers| along_surface(&layers));
    let without_network = (with_surface && !args.model.without_network()).then_some(WITHOUT_NETWORK);
    let without_network = without_network.into_iter().flatten().map(|layers| (layers, RowEngine::NoNetwork));
    let rows: Vec<_> = own.chain(without_network).chain(others).collect();
    let widths = if args.widths.is_empty() { vec![None] } else { args.widths.iter().copied().map(Some).collect() };
    let of_width = |width: Option<usize>| {
        rows.iter().cloned().map(move |(layers, engine)| Configuration { width, layers, engine })
    };
    widths.into_iter().flat_map(of_width).collect()
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

/// The reference implementations, on the most planes.
fn references(
    args: &SweepArgs,
    command: &str,
    scene_views: &SceneViews,
    width: Option<usize>,
    own: &Value,
    folder: &Path,
) -> Result<Vec<Measured>> {
    let planes = args.layers.iter().filter_map(|layers| match layers {
        LayerSpec::Planes(count) => Some(*count),
        _ => None,
    });
    let Some(planes) = planes.max() else { bail!("--reference: expected planes among --layers, to measure it on") };
    let size = size(own);
    let file = folder.join(format!("job_{}.npz", size.width));
    let targets = scaled(Targets::held_out(scene_views.scene(), named(scene_views.scene(), &args.target)?), width)?;
    let shot = scene_views.shots(targets, views(own), 0, None)?.remove(0);
    write_job(&file, scene_views, &shot, planes)?;
    let model = args.model.general_file()?;
    let weights = model.with_extension("pt");
    let words = words(command);
    let start = |engine: &str| {
        let job = json!({
            "job": text_of(&file)?, "model": text_of(&model)?, "weights": weights.is_file().then(|| path_text(&weights)),
            "engine": engine, "threads": args.model.threads(), "batch": args.model.batch,
        });
        let (worker, ready) = WorkerProcess::start(engine, &words, Some(&job))?;
        Ok(Measured::new(worker, Row { count: planes, ..Row::new(&format!("planes:{planes}"), &ready, true, size) }))
    };
    REFERENCES.into_iter().map(start).collect()
}

/// Writes the job of a reference: the target, its views and uniform planes.
fn write_job(path: &Path, scene_views: &SceneViews, shot: &Shot, planes: usize) -> Result<()> {
    let mut arrays = Arrays::create(path)?;
    arrays.add_rig(scene_views, shot)?;
    arrays.add("disparities", Array1::from_vec(uniform_disparities(shot.near, shot.far, planes)?))?;
    arrays.finish()
}
