//! `liveview sweep`: error against run time.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use liveview_bench::{Configuration, Progress, RowEngine, SweepSettings, Worker};
use liveview_live::peak_memory;
use liveview_synthesizer::LayerSpec;
use serde_json::Value;

use crate::args::{MORE_HELP, ModelArgs, ProviderChoice, SceneArgs, named, numbers, refuse_stdout, write_atomically};
use crate::console::{Output, print_message, print_notes, progress};
use crate::job::Job;
use crate::outputs::OutputPlan;

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
    pub(crate) fn is_worker(&self) -> bool {
        self.worker.is_some()
    }
}

pub(crate) fn run(args: &SweepArgs) -> Result<Output> {
    let settings = SweepSettings {
        scene: args.scene.folder().display().to_string(),
        targets: args.target.clone(),
        layers: args.layers.clone(),
        widths: args.widths.clone(),
        engines: args.engines.len(),
        without_network: args.model.without_network(),
        repetitions: args.repetitions,
        reference: args.reference.clone(),
        threads: args.model.threads(),
        batch: args.model.batch,
    };
    if let Some(&[number, views]) = args.worker.as_deref() {
        let all = liveview_bench::configurations(&settings);
        let configuration = all.get(number).with_context(|| format!("--worker {number}: there are {}", all.len()))?;
        return run_worker(args, configuration, views);
    }
    let photos = args.scene.open()?;
    print_notes(&photos.scene().notes);
    refuse_stdout("-o", &args.output)?;
    let mut output_plan = OutputPlan::new(photos.scene());
    output_plan.folder("-o", &args.output)?;
    FILES.iter().try_for_each(|name| output_plan.named_file("-o", &args.output.join(name)))?;
    output_plan.prepare()?;
    let held_out = named(photos.scene(), &args.target)?;
    let bar = progress()?.with_prefix("renders");
    let mut report = |what: Progress| match what {
        Progress::More(renders) => bar.inc_length(renders as u64),
        Progress::Next(name) => bar.set_message(name),
        Progress::Done => bar.inc(1),
    };
    let sweep = liveview_bench::run(&settings, &photos, &held_out, &|| args.model.general_file(), &mut report)?;
    bar.finish_and_clear();
    if sweep.noisy() {
        print_message(
            "warning",
            "the times of the repetitions differ widely: the machine is too busy for reliable times",
        );
    }
    if sweep.has_no_score() {
        print_message("warning", "the plot is empty: no picture has a score, because they are too small");
    }
    let (text, json) = (sweep.markdown(), sweep.json());
    for (name, contents) in FILES.into_iter().zip([format!("{json:#}\n"), text.clone(), sweep.plot()]) {
        write_atomically(&args.output.join(name), contents.as_bytes())?;
    }
    Ok(Output { text, json })
}

/// Runs a configuration; without a network from so many views.
fn run_worker(args: &SweepArgs, configuration: &Configuration, views: usize) -> Result<Output> {
    let model = match configuration.engine {
        RowEngine::Own => args.model.with_network(None),
        RowEngine::Other(engine) => args.model.with_network(Some(args.engines[engine])),
        RowEngine::NoNetwork => args.model.no_network(views),
    };
    let Job { synthesizer, model, .. } = Job::with_layers(args.scene.open()?, &model, Some(&configuration.layers))?;
    let held_out = named(synthesizer.scene(), &args.target)?;
    let (engine, weighting) = (model.engine(), model.weighting_stage());
    let worker = Worker { synthesizer, engine, model: model.path().map(Into::into), weighting, peak_memory };
    worker.run(held_out, configuration.width)?;
    Ok(Output { text: String::new(), json: Value::Null })
}
