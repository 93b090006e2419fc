//! `liveview select`: the planes that a view needs, or the depth range of each pixel.

use std::fmt::Write;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use clap::Args;
use glam::DVec2;
use liveview::geometry::PlaneSweep;
use liveview::geometry::parallax::parallax;
use liveview::image::{bar_chart, coloured, side_by_side};
use liveview::layers::guided::{COARSE, RangeMap};
use liveview::layers::{CELL, uniform_disparities};
use liveview::{Camera, ImageRgb, LayerSpec, ScenePhotos, SceneViews, Shot, Targets};
use liveview_common::args::model::ModelArgs;
use liveview_common::args::output::expect_png;
use liveview_common::args::scene::SceneArgs;
use liveview_common::console::{Output, path_text, print_notes, progress};
use liveview_common::job::Job;
use liveview_common::outputs::OutputPlan;
use liveview_common::statistics::quantile;
use ndarray::Array2;
use serde_json::{Value, json};

const EXAMPLES: &str = "\
Examples:
  The histogram over 64 planes, and the 16 that are selected:
    liveview select scene --target IMG_7.jpg -o planes.png
  Another number of planes:
    liveview select scene --target IMG_7.jpg --layers select:8/128
  The depth range of each pixel, for guided layers:
    liveview select scene --target IMG_7.jpg --layers guided:4 -o range.png";

/// Quantiles of the pixels that describe the range map.
const QUANTILES: [f64; 5] = [0.05, 0.25, 0.5, 0.75, 0.95];

/// Options of `liveview select`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct SelectArgs {
    /// Target view, by name, held out
    #[arg(long, value_name = "NAME")]
    target: String,
    /// select:K/D: the histogram over D planes and the K selected; guided:L: the depth range of
    /// each pixel
    #[arg(long, value_name = "SPEC", default_value = "select:16/64")]
    layers: LayerSpec,
    /// Picture of the histogram or of the depth ranges
    ///
    /// The histogram has one bar per plane, near to far, selected planes in colour. The ranges are
    /// nearest disparity, farthest disparity and width in pixels of parallax, side by side.
    #[arg(short, long, value_name = "PNG")]
    output: Option<PathBuf>,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    scene: SceneArgs,
}

pub(crate) fn run(args: &SelectArgs) -> Result<Output> {
    let views = args.scene.open()?;
    print_notes(&views.scene().notes);
    let target = Targets::held_out(views.scene(), vec![views.scene().view_index(&args.target)?]);
    if let Some(file) = &args.output {
        expect_png("-o", file)?;
        let mut output_plan = OutputPlan::new(views.scene());
        output_plan.file("-o", file)?;
        output_plan.prepare()?;
    }
    let (mut output, picture) = match args.layers {
        LayerSpec::Guided { layers, coarse_planes } => guided(args, views, target, layers, coarse_planes)?,
        LayerSpec::Select { keep, from } => planes(args, views, target, keep, from)?,
        _ => bail!("--layers {}: expected select:K/D or guided:L", args.layers),
    };
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

/// The depth range of each pixel, for guided layers.
fn guided(
    args: &SelectArgs,
    views: SceneViews,
    target: Targets,
    layers: usize,
    coarse_planes: Option<usize>,
) -> Result<(Output, ImageRgb)> {
    args.model.set_threads()?;
    let shot = views.shots(target, args.model.views_or_default(), 0, None)?.remove(0);
    let mut photos = ScenePhotos::new(views);
    let loaded = photos.load(&shot, &[])?;
    let started = Instant::now();
    let found = loaded.search(coarse_planes)?;
    let time = started.elapsed();
    let range = &found.range;
    let width = width_in_pixels(photos.views(), &shot, range);

    let mut text = heading(photos.views(), &shot);
    let _ = writeln!(
        text,
        "search   {} planes on cells of {COARSE}x{COARSE} pixels, {} layers on {CELL}x{CELL}, {:.0} ms",
        found.disparities.len(),
        found.fine_layers.dim().0,
        1e3 * time.as_secs_f64()
    );
    let percent = QUANTILES.map(|fraction| format!("{:>9}", format!("{:.0} %", 100.0 * fraction))).concat();
    let _ = writeln!(text, "\npercentile of the pixels        {percent}");
    let mut json = heading_json(photos.views(), &shot);
    let rows: [(&str, &str, Array2<f32>); 4] = [
        ("farthest depth, scene units", "farthest_depth", range.farthest().mapv(|disparity| 1.0 / disparity)),
        ("nearest depth, scene units", "nearest_depth", range.nearest().mapv(|disparity| 1.0 / disparity)),
        ("width, pixels of parallax", "width_pixels", width.clone()),
        ("between layers, pixels", "step_pixels", width.mapv(|width| width / layers.saturating_sub(1).max(1) as f32)),
    ];
    for (name, key, map) in rows {
        let mut values: Vec<f64> = map.iter().map(|&value| value.into()).collect();
        let values = QUANTILES.map(|fraction| quantile(&mut values, fraction));
        let _ = writeln!(text, "{name:32}{}", values.map(|value| format!("{value:9.3}")).concat());
        json[key] = json!(values);
    }
    json["percentiles"] = json!(QUANTILES.map(|fraction| 100.0 * fraction));
    let widest = width.iter().copied().fold(0.0, f32::max);
    let _ = writeln!(
        text,
        "\npicture: nearest | farthest disparity (dark at far, light at near) | width (light at {widest:.1} pixels)"
    );
    Ok((Output { text, json }, range_picture(&shot, range, &width)))
}

/// Nearest disparity, farthest disparity and width of the range, side by side.
pub(super) fn range_picture(shot: &Shot, range: &RangeMap, width: &Array2<f32>) -> ImageRgb {
    let (low, high) = ((1.0 / shot.far) as f32, (1.0 / shot.near) as f32);
    let widest = width.iter().copied().fold(0.0, f32::max);
    let size = (shot.target.height(), shot.target.width());
    let full = |map: &Array2<f32>| Array2::from_shape_fn(size, |(y, x)| map[(y / CELL, x / CELL)]);
    let maps = [(range.nearest(), low, high), (range.farthest(), low, high), (width, 0.0, widest)]
        .map(|(map, low, high)| coloured(full(map).view(), low, high));
    side_by_side(&maps.each_ref())
}

/// The depth range of each cell in pixels of parallax, in the view where it is largest.
pub(super) fn width_in_pixels(views: &SceneViews, shot: &Shot, range: &RangeMap) -> Array2<f32> {
    let views: Vec<(&Camera, PlaneSweep)> =
        views.cameras(&shot.views).map(|view| (view, PlaneSweep::new(view, &shot.target))).collect();
    Array2::from_shape_fn(range.nearest().dim(), |(y, x)| {
        let pixel = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) * CELL as f64;
        let ends = (range.nearest()[(y, x)].into(), range.farthest()[(y, x)].into());
        views.iter().filter_map(|(view, sweep)| parallax(view, sweep, pixel, ends)).fold(0.0, f64::max) as f32
    })
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
