//! `liveview dump`: every stage of one render as arrays, for `python -m liveview_ref.parity`.

use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use liveview::Targets;
use liveview_bench::dump;
use serde_json::json;

use crate::args::layers::LayerArgs;
use crate::args::model::ModelArgs;
use crate::args::scene::SceneArgs;
use crate::console::{Output, path_text, print_notes};
use crate::interrupt::{self, Interrupted};
use crate::job::Job;
use crate::outputs::OutputPlan;

/// Options of `liveview dump`.
#[derive(Debug, Args)]
#[command(after_help = "--help also lists the advanced options.", after_long_help = "")]
pub(crate) struct DumpArgs {
    /// The view to render, by name; it is held out
    #[arg(long, value_name = "NAME")]
    target: String,
    #[command(flatten)]
    layers: LayerArgs,
    #[command(flatten)]
    model: ModelArgs,
    /// Where to write the arrays
    #[arg(short, long, value_name = "NPZ")]
    output: PathBuf,
    /// Surface layers: also how the depth of the photos was found, and all photos of the scene
    #[arg(long)]
    search: bool,
    #[command(flatten)]
    scene: SceneArgs,
}

pub(crate) fn run(args: &DumpArgs) -> Result<Output> {
    if args.output.extension().is_none_or(|ending| ending != "npz") {
        bail!("-o {}: expected a name that ends in .npz", args.output.display());
    }
    let mut job = Job::open(args.scene.open()?, &args.layers, &args.model)?;
    let targets = Targets::held_out(job.scene(), vec![job.scene().view_index(&args.target)?]);
    let Some(shot) = job.synthesizer.shots(targets)?.pop() else { bail!("{}: nothing to render", args.target) };
    print_notes(&job.scene().notes);
    let mut output_plan = OutputPlan::new(job.scene());
    output_plan.file("-o", &args.output)?;
    output_plan.prepare()?;
    interrupt::watch(job.synthesizer.renderer().network().run_end().into_iter().collect())?;
    let loaded = job.synthesizer.load(&shot, &[])?;
    let of_surface = (args.layers.photo_correction(), args.search);
    let written = dump::write(&mut job.synthesizer, &loaded, of_surface, &args.output, interrupt::requested);
    // A network run that is ended after an interrupt is an error of its own.
    written.map_err(|error| if interrupt::requested() { Interrupted.into() } else { error })?;
    let model = job.model.model.as_ref();
    let json = json!({
        "file": path_text(&args.output), "target": shot.name, "views": job.views().names(&shot.views), "near": shot.near,
        "far": shot.far, "layers": job.layers().to_string(), "model": model.map(|model| path_text(&model.path)),
        "library": model.map(|model| path_text(&model.library)), "engine": model.map_or("none", |model| model.provider.name()),
        "precision": model.map(|model| &model.precision), "alpha": job.alpha().to_string(),
        "threads": job.model.threads, "batch": job.model.batch,
    });
    Ok(Output { text: format!("{}: every stage of {}, {}", args.output.display(), shot.name, job.layers()), json })
}
