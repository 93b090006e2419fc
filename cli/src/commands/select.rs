//! `liveview select`: the planes that a view needs.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use liveview::image::bar_chart;
use liveview::layers::uniform_disparities;
use liveview::{ImageRgb, LayerSpec, SceneViews, Shot, Targets};
use liveview_common::args::model::ModelArgs;
use liveview_common::args::output::expect_png;
use liveview_common::args::scene::SceneArgs;
use liveview_common::console::{Output, path_text, print_notes, progress};
use liveview_common::job::Job;
use liveview_common::outputs::OutputPlan;
use serde_json::{Value, json};

const EXAMPLES: &str = "\
Examples:
  The histogram over 64 planes, and the 16 that are selected:
    liveview select scene --target IMG_7.jpg -o planes.png
  Another number of planes:
    liveview select scene --target IMG_7.jpg --layers select:8/128";

/// Options of `liveview select`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct SelectArgs {
    /// Target view, by name, held out
    #[arg(long, value_name = "NAME")]
    target: String,
    /// select:K/D: the histogram over D planes, and the K selected
    #[arg(long, value_name = "SPEC", default_value = "select:16/64")]
    layers: LayerSpec,
    /// Picture of the histogram: one bar per plane, near to far, selected planes in colour
    #[arg(short, long, value_name = "PNG")]
    output: Option<PathBuf>,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    scene: SceneArgs,
}

pub(crate) fn run(args: &SelectArgs) -> Result<Output> {
    if args.model.without_network() {
        bail!("--network none: cannot be used here: a network selects the planes");
    }
    let views = args.scene.open()?;
    print_notes(&views.scene().notes);
    let target = Targets::held_out(views.scene(), vec![views.scene().view_index(&args.target)?]);
    if let Some(file) = &args.output {
        expect_png("-o", file)?;
        let mut output_plan = OutputPlan::new(views.scene());
        output_plan.file("-o", file)?;
        output_plan.prepare()?;
    }
    let LayerSpec::Select { keep, from } = args.layers else {
        bail!("--layers {}: expected select:K/D", args.layers);
    };
    let (mut output, picture) = planes(args, views, target, keep, from)?;
    if let Some(file) = &args.output {
        picture.save(file)?;
        let _ = writeln!(output.text, "wrote    {}", file.display());
        output.json["file"] = json!(path_text(file));
    }
    Ok(output)
}

/// The paper's histogram over planes.
fn planes(
    args: &SelectArgs,
    views: SceneViews,
    target: Targets,
    keep: usize,
    from: usize,
) -> Result<(Output, ImageRgb)> {
    let mut job = Job::with_layers(views, &args.model, Some(&args.layers))?;
    let shot = job.synthesizer.shots(target)?.remove(0);
    let loaded = job.synthesizer.load(&shot, &[])?;
    job.progress = progress("layers")?;
    let disparities = uniform_disparities(shot.near, shot.far, from)?;
    let histogram = job.synthesizer.histogram(&loaded, &disparities)?;
    job.progress.finish_and_clear();
    let chosen = job.alpha().select_planes(&histogram, keep);

    let pixels = (shot.target.width() * shot.target.height()) as f64;
    let share = |k: usize| 100.0 * histogram[k] as f64 / pixels;
    let kept: f64 = chosen.iter().map(|&k| share(k)).sum();
    let uncovered = 100.0 * (pixels - histogram.iter().sum::<u64>() as f64) / pixels;
    let mut text = heading(job.views(), &shot);
    let _ = writeln!(text, "selected {} of {} planes, which {kept:.1} % of the pixels choose", chosen.len(), from);
    let _ = writeln!(text, "skipped  {} planes; no view covers {uncovered:.1} % of the pixels", from - chosen.len());
    let _ = writeln!(text, "\nplane  disparity      depth  pixels");
    for &k in &chosen {
        let _ = writeln!(text, "{k:5}  {:9.5}  {:9.4}  {:4.1} %", disparities[k], 1.0 / disparities[k], share(k));
    }
    let mut json = heading_json(job.views(), &shot);
    json["disparities"] = json!(disparities);
    json["histogram"] = json!(histogram);
    json["chosen"] = json!(chosen);
    Ok((Output { text, json }, bar_chart(&histogram, &chosen)))
}

fn heading(views: &SceneViews, shot: &Shot) -> String {
    let (width, height) = (shot.target.width(), shot.target.height());
    let views = views.names(&shot.views).join(", ");
    format!(
        "target   {}, {width}x{height}, held out, from {views}\ndepth    {:.4} to {:.4} scene units\n",
        shot.name, shot.near, shot.far
    )
}

fn heading_json(views: &SceneViews, shot: &Shot) -> Value {
    json!({
        "scene": path_text(&views.scene().root), "target": shot.name, "views": views.names(&shot.views),
        "near": shot.near, "far": shot.far, "notes": views.scene().notes,
    })
}
