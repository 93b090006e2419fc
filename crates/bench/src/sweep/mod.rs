//! `liveview sweep`: error against run time. Each configuration runs in a worker process; their repetitions are interleaved.

mod configuration;
mod cpu;
mod job_file;
mod markdown;
mod measured;
mod plot;
mod rows;
mod svg;
mod worker;

use std::ffi::OsString;
use std::path::Path;

use anyhow::{Context, Result, bail};
pub use configuration::SweepArgs;
use configuration::{Configuration, RowEngine, configurations};
use cpu::cpu;
use job_file::write_job;
use liveview::fs::unfinished::Unfinished;
use liveview::geometry::Size;
use liveview::{LayerSpec, SceneViews, Targets};
use liveview_common::args::output::{refuse_stdout, write_atomically};
use liveview_common::args::targets::named;
use liveview_common::console::{Output, path_text, print_message, print_notes, progress};
use liveview_common::outputs::OutputPlan;
use measured::Measured;
use rows::{Row, SweepReport};
use serde_json::{Value, json};
use worker::scaled;

use crate::worker_process::{WorkerProcess, text_of};

/// Engines of `python -m liveview_ref.competitors.worker`.
const REFERENCES: [&str; 4] = ["reference", "torch", "torch channels_last", "onnxruntime + kornia"];

/// The files written.
const FILES: [&str; 3] = ["sweep.json", "sweep.md", "sweep.svg"];

/// Runs `liveview sweep`.
pub fn run(args: &SweepArgs) -> Result<Output> {
    if let Some(&[number, views]) = args.worker.as_deref() {
        let all = configurations(args);
        let configuration = all.get(number).with_context(|| format!("--worker {number}: there are {}", all.len()))?;
        return worker::run(args, configuration, views);
    }
    let folder = Unfinished::folder().context("a temporary folder for the workers' pictures cannot be created")?;
    let photos = args.scene.open()?;
    print_notes(&photos.scene().notes);
    refuse_stdout("-o", &args.output)?;
    let mut output_plan = OutputPlan::new(photos.scene());
    output_plan.folder("-o", &args.output)?;
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
            measured.push(Measured { worker, row: Row::new(&name, &ready, false, size(&ready)) });
        }
        if let Some(command) = &args.reference {
            measured.extend(references(args, command, &photos, configurations[0].1.width, &own, folder.path())?);
        }
        bar.inc_length((measured.len() * (args.repetitions + 1)) as u64);
        for one in &mut measured {
            bar.set_message(one.row.name());
            one.warm_up(&truths, folder.path())?;
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

/// The command line of a worker: that of this process, and which configuration it runs.
fn worker_command(number: usize, views: usize) -> Result<Vec<OsString>> {
    let mut command = vec![std::env::current_exe()?.into_os_string()];
    command.extend(std::env::args_os().skip(1));
    let at = command.iter().position(|word| word == "sweep").context("expected the command sweep")? + 1;
    let worker = ["--worker".into(), number.to_string().into(), views.to_string().into()];
    command.splice(at..at, worker);
    Ok(command)
}

/// The reference implementations, on the most planes; `command` has no quotes.
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
    let words: Vec<OsString> = command.split_whitespace().map(OsString::from).collect();
    let start = |engine: &str| {
        let job = json!({
            "job": text_of(&file)?, "model": text_of(&model)?, "weights": weights.is_file().then(|| path_text(&weights)),
            "engine": engine, "threads": args.model.threads(), "batch": args.model.batch,
        });
        let (worker, ready) = WorkerProcess::start(engine, &words, Some(&job))?;
        let row = Row { count: planes, ..Row::new(&format!("planes:{planes}"), &ready, true, size) };
        Ok(Measured { worker, row })
    };
    REFERENCES.into_iter().map(start).collect()
}
