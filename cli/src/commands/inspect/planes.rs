//! The planes that a view needs: the paper's histogram, and the planes that are selected by it.

use std::fmt::Write;

use anyhow::{Result, bail};
use liveview::ImageRgb;
use liveview::geometry::middle_camera;
use liveview::layers::uniform_disparities;
use liveview_synthesizer::colormap::bar_chart;
use liveview_synthesizer::{LayerSpec, Shot, Targets, select_planes};
use serde_json::json;

use super::args::InspectArgs;
use crate::args::output::expect_png;
use crate::console::{Output, path_text, print_notes, progress};
use crate::job::Job;
use crate::outputs::OutputPlan;

/// Planes by default.
const LAYERS: LayerSpec = LayerSpec::PAPER;

pub(super) fn run(args: &InspectArgs) -> Result<Output> {
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
    if let Some(file) = &args.output {
        expect_png("-o", file)?;
        let mut output_plan = OutputPlan::new(views.scene());
        output_plan.file("-o", file)?;
        output_plan.prepare()?;
    }
    let layers = args.layers.as_ref().unwrap_or(&LAYERS);
    let LayerSpec::Select { keep, from } = *layers else { bail!("--layers {layers}: expected select:K/D") };
    let job = Job::with_layers(views, &args.model, Some(layers))?;
    let (mut output, picture) = planes(job, target, keep, from)?;
    if let Some(file) = &args.output {
        picture.save(file)?;
        let _ = writeln!(output.text, "wrote    {}", file.display());
        output.json["file"] = json!(path_text(file));
    }
    Ok(output)
}

/// The paper's histogram over planes.
fn planes(mut job: Job, target: Targets, keep: usize, from: usize) -> Result<(Output, ImageRgb)> {
    let shot = job.synthesizer.shots(target)?.remove(0);
    let loaded = job.synthesizer.load(&shot, &[])?;
    job.progress = progress("layers")?;
    let disparities = uniform_disparities(shot.near, shot.far, from)?;
    let histogram = job.synthesizer.histogram(&loaded, &disparities)?;
    job.progress.finish_and_clear();
    let chosen = select_planes(job.alpha(), &histogram, keep);

    let pixels = (shot.target.width() * shot.target.height()) as f64;
    let share = |k: usize| 100.0 * histogram[k] as f64 / pixels;
    let kept: f64 = chosen.iter().map(|&k| share(k)).sum();
    let uncovered = 100.0 * (pixels - histogram.iter().sum::<u64>() as f64) / pixels;
    let (scene, views) = (job.scene(), job.views().names(&shot.views));
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
    Ok((Output { text, json }, bar_chart(&histogram, &chosen)))
}
