//! `liveview sweep`: error against run time, for kinds and numbers of layers. Each configuration runs in a worker process; their
//! repetitions are interleaved.

mod plot;
mod report;
mod worker;

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use indicatif::ProgressBar;
use liveview::geometry::Size;
use liveview_synthesizer::{LayerSpec, ViewAgreement};
use serde_json::Value;

use crate::args::{MORE_HELP, ModelArgs, ProviderChoice, SceneArgs, named, numbers, refuse_stdout, write_atomically};
use crate::console::{Output, path_text, print_message, print_notes, progress};
use crate::outputs::OutputPlan;
pub(crate) use report::quantile;
use report::{Row, SweepReport};
pub(crate) use worker::send_line;
use worker::{Measured, WorkerProcess};

const EXAMPLES: &str = "\
Examples:
  liveview sweep scene --target IMG_7.jpg -o report/
  liveview sweep scene --target IMG_7.jpg --layers guided:4,planes:16 --widths 500,1000,2000 -o scaling/";

/// Kinds and numbers of layers.
const LAYERS: &str = "surface:1,surface:2,guided:1,guided:2,guided:3,guided:4,guided:6,guided:8,guided:12,select:8,select:16,\
                      select:32,planes:8,planes:16,planes:32,planes:64";

/// The files written.
const FILES: [&str; 3] = ["sweep.json", "sweep.md", "sweep.svg"];

/// Options of `liveview sweep`.
#[derive(Debug, Args)]
#[command(after_help = MORE_HELP, after_long_help = EXAMPLES)]
pub(crate) struct SweepArgs {
    /// Views to render, by name, all held out: scores are their means, times those of the first
    #[arg(long, value_name = "NAME,…", required = true)]
    target: Vec<String>,
    /// Layers to measure, separated by commas; with any surface layers, also surface:1 and surface:3 without a
    /// network [default: several of each kind]
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
    pub(crate) fn is_worker(&self) -> bool {
        self.worker.is_some()
    }
}

pub(crate) fn run(args: &SweepArgs) -> Result<Output> {
    let configurations = configurations(args);
    if let Some(&[number, views]) = args.worker.as_deref() {
        let configuration = configurations.get(number);
        let none = || format!("--worker {number}: there are {}", configurations.len());
        return worker::run(args, configuration.with_context(none)?, views);
    }
    let photos = args.scene.open()?;
    print_notes(&photos.scene().notes);
    refuse_stdout("-o", &args.output)?;
    let mut output_plan = OutputPlan::new(photos.scene());
    output_plan.folder("-o", &args.output)?;
    FILES.iter().try_for_each(|name| output_plan.named_file("-o", &args.output.join(name)))?;
    output_plan.prepare()?;
    let targets = named(photos.scene(), &args.target)?.len();
    let bar = progress()?.with_prefix("renders");
    let sweep = measure(args, &configurations, targets, &bar)?;
    bar.finish_and_clear();
    if sweep.noisy() {
        print_message(
            "warning",
            "the times of the repetitions differ widely: the machine is too busy for reliable times",
        );
    }
    if sweep.rows.iter().all(|row| row.score.is_none()) {
        print_message("warning", "the plot is empty: no picture has a score, because they are too small");
    }
    let (text, json) = (sweep.markdown(), sweep.json());
    for (name, contents) in FILES.into_iter().zip([format!("{json:#}\n"), text.clone(), sweep.plot()]) {
        write_atomically(&args.output.join(name), contents.as_bytes())?;
    }
    Ok(Output { text, json })
}

/// Measures all configurations, on so many targets. Each runs in a process of its own: this command line, with the option
/// `--worker`.
fn measure(
    args: &SweepArgs,
    configurations: &[Configuration],
    targets: usize,
    bar: &ProgressBar,
) -> Result<SweepReport> {
    let (mut all, mut own, mut models) = (Vec::new(), Value::Null, Vec::new());
    let numbered: Vec<_> = configurations.iter().enumerate().collect();
    for of_width in numbered.chunk_by(|(_, a), (_, b)| a.width == b.width) {
        let mut measured = Vec::new();
        for (number, Configuration { layers, engine, .. }) in of_width {
            let name = layers.to_string();
            let (worker, ready) = WorkerProcess::start(&name, &worker_command(*number, views(&own))?)?;
            let model = model(&ready);
            if !model.is_empty() && !models.contains(&model) {
                models.push(model);
            }
            if let RowEngine::Own = engine {
                own = ready.clone();
            }
            measured.push(Measured { worker, row: Row::new(&name, &ready, size(&ready)) });
        }
        bar.inc_length((measured.len() * (args.repetitions + 1)) as u64);
        for one in &mut measured {
            bar.set_message(one.row.name());
            one.warm_up(targets)?;
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
    Ok(SweepReport {
        scene: path_text(args.scene.folder()),
        targets: args.target.clone(),
        views: views(&own),
        model: if models.is_empty() { "none".into() } else { models.join(", ") },
        threads: args.model.threads(),
        batch: args.model.batch,
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

/// The engine of a row.
#[derive(Debug, Clone, Copy)]
enum RowEngine {
    /// That of the options.
    Own,
    /// A further one.
    Other(ProviderChoice),
    /// None: views are weighted by their agreement.
    NoNetwork,
}

/// What a row measures.
#[derive(Debug)]
struct Configuration {
    /// Of the target, pixels; `None`: the photo's.
    width: Option<usize>,
    layers: LayerSpec,
    engine: RowEngine,
}

/// The configurations of all rows, width by width; of each those on the engine of the options first.
fn configurations(args: &SweepArgs) -> Vec<Configuration> {
    let is_light = |layers: &&LayerSpec| matches!(layers.kind(), "surface" | "guided");
    let mut rows: Vec<_> = args.layers.iter().map(|layers| (layers.clone(), RowEngine::Own)).collect();
    if args.layers.iter().any(|layers| layers.kind() == "surface") && !args.model.without_network() {
        rows.extend(WITHOUT_NETWORK.map(|layers| (layers, RowEngine::NoNetwork)));
    }
    for &engine in &args.engines {
        rows.extend(args.layers.iter().filter(is_light).map(|layers| (layers.clone(), RowEngine::Other(engine))));
    }
    let widths: Vec<_> = args.widths.iter().copied().map(Some).collect();
    let of_width = |&width: &Option<usize>| {
        rows.iter().cloned().map(move |(layers, engine)| Configuration { width, layers, engine })
    };
    if widths.is_empty() { of_width(&None).collect() } else { widths.iter().flat_map(of_width).collect() }
}
