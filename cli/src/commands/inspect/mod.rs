//! `liveview inspect`: how a scene is read, which planes a view needs, or what a model is.

mod scene;

use std::fmt::Write;
use std::path::Path;

use anyhow::{Result, bail};
use clap::Args;
use liveview::geometry::middle_camera;
use liveview::layers::uniform_disparities;
use liveview::network::{ExecutionProvider, ModelCard, OrtLibrary, OrtNetwork};
use liveview_synthesizer::{LayerSpec, Shot, SynthesisError, Targets, recommended_layers, select_planes};
use serde_json::{Value, json};

use crate::args::{ModelArgs, SceneArgs, has_extension};
use crate::console::{Output, escaped, path_text, print_notes};
use crate::job::Job;

pub(crate) fn run(args: &InspectArgs) -> Result<Output> {
    let path = args.scene.folder();
    if has_extension(path, &["onnx"]) {
        return model(path, &args.model);
    }
    if args.planes {
        return planes(args);
    }
    if let Some(option) = args.model.option_of_run() {
        bail!("{option}: expected --planes with it");
    }
    scene::report(args, &args.scene.open()?)
}

const EXAMPLES: &str = "\
Examples:
  liveview inspect scene
  liveview inspect scene --target IMG_7.jpg --views 5 --layers planes:128
  The histogram over 64 planes, and the 16 that are selected:
    liveview inspect scene --target IMG_7.jpg --planes
  A model's card:
    liveview inspect models/liveview_v4.onnx";

/// Help of the first argument.
const PATH: &str = "Scene folder as for `render`, or a model (.onnx)";

/// Options of `liveview inspect`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, mut_arg("scene", |scene| scene.help(PATH)))]
pub(crate) struct InspectArgs {
    /// View to use as the target, held out [default: the middle one]
    #[arg(long, value_name = "NAME")]
    pub(super) target: Option<String>,
    /// Planes whose spacing to check: planes:D or list:… [default: planes:64]; with --planes
    /// select:K/D, the histogram over D planes and the K selected [default: select:16/64]
    #[arg(long, value_name = "SPEC")]
    pub(super) layers: Option<LayerSpec>,
    /// Print which planes the target needs instead, by the network
    #[arg(long)]
    pub(super) planes: bool,
    #[command(flatten)]
    pub(super) model: ModelArgs,
    #[command(flatten)]
    pub(super) scene: SceneArgs,
}

/// The card of a model.
fn model(file: &Path, args: &ModelArgs) -> Result<Output> {
    let card = card(&library(args)?, file)?;
    Ok(Output { text: card_text(&escaped(&path_text(file)), &card), json: card_json(file, &card) })
}

fn library(args: &ModelArgs) -> Result<OrtLibrary> {
    let provider = ExecutionProvider::Cpu;
    Ok(OrtLibrary::load(provider, args.library(provider).as_deref()).map_err(SynthesisError::from)?)
}

/// The card of a model; an error if it cannot be opened or has no layers.
fn card(library: &OrtLibrary, file: &Path) -> Result<ModelCard, SynthesisError> {
    let network = OrtNetwork::open(library, file, 1)?;
    recommended_layers(&network)?;
    Ok(network.card().clone())
}

fn card_text(file: &str, card: &ModelCard) -> String {
    let kinds = if card.layer_kinds.is_empty() { "all".to_owned() } else { card.layer_kinds.join(", ") };
    format!(
        "{file}\n  views       {}\n  precision   {}\n  layers      {}, recommended {}\n  alpha       {}\n  training    {}\n  licence     {}\n",
        card.views,
        escaped(&card.precision),
        escaped(&kinds),
        escaped(&card.recommended_layers),
        card.alpha(None),
        escaped(&card.training),
        escaped(&card.licence)
    )
}

fn card_json(file: &Path, card: &ModelCard) -> Value {
    json!({
        "file": path_text(file), "views": card.views, "precision": card.precision, "layer_kinds": card.layer_kinds,
        "recommended_layers": card.recommended_layers, "alpha": card.alpha(None).to_string(),
        "training": card.training, "licence": card.licence,
    })
}

/// The planes that a view needs: the paper's histogram, and the planes that are selected by it.
fn planes(args: &InspectArgs) -> Result<Output> {
    if args.model.without_network() {
        bail!("--network none: cannot be used here: a network selects the planes");
    }
    let views = args.scene.open()?;
    print_notes(&views.scene().notes);
    let target = match &args.target {
        Some(name) => views.scene().view_index(name)?,
        None => middle_camera(&views.all_cameras()),
    };
    let target = Targets::held_out(views.scene(), vec![target]);
    let layers = args.layers.as_ref().unwrap_or(&LayerSpec::PAPER);
    let LayerSpec::Select { keep, from } = *layers else { bail!("--layers {layers}: expected select:K/D") };
    let job = Job::with_layers(views, &args.model, Some(layers))?;
    histogram(job, target, keep, from)
}

/// The paper's histogram over planes.
fn histogram(mut job: Job, target: Targets, keep: usize, from: usize) -> Result<Output> {
    let shot = job.synthesizer.shots(target)?.remove(0);
    let loaded = job.synthesizer.load(&shot, &[])?;
    let disparities = uniform_disparities(shot.near, shot.far, from)?;
    let histogram = job.synthesizer.histogram(&loaded, &disparities)?;
    let chosen = select_planes(job.synthesizer.renderer().alpha(), &histogram, keep);

    let pixels = (shot.target.width() * shot.target.height()) as f64;
    let share = |k: usize| 100.0 * histogram[k] as f64 / pixels;
    let kept: f64 = chosen.iter().map(|&k| share(k)).sum();
    let uncovered = 100.0 * (pixels - histogram.iter().sum::<u64>() as f64) / pixels;
    let (scene, views) = (job.synthesizer.scene(), job.synthesizer.views().names(&shot.views));
    let Shot { name, near, far, .. } = &shot;
    let mut text = format!(
        "target   {name}, {}x{}, held out, from {}\ndepth    {near:.4} to {far:.4} scene units\n",
        shot.target.width(),
        shot.target.height(),
        views.join(", ")
    );
    let _ = writeln!(text, "selected {} of {} planes, which {kept:.1} % of the pixels choose", chosen.len(), from);
    let _ = writeln!(text, "skipped  {} planes; no view covers {uncovered:.1} % of the pixels", from - chosen.len());
    let _ = writeln!(text, "\nplane  disparity      depth  pixels");
    for &k in &chosen {
        let _ = writeln!(text, "{k:5}  {:9.5}  {:9.4}  {:4.1} %", disparities[k], 1.0 / disparities[k], share(k));
    }
    let json = json!({
        "scene": path_text(&scene.root), "target": name, "views": views, "near": near, "far": far, "notes": scene.notes,
        "disparities": disparities, "histogram": histogram, "chosen": chosen,
    });
    Ok(Output { text, json })
}
