//! `liveview depth`: the depth of the photos, as pictures and as numbers.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use anyhow::{Context, Result, bail};
use clap::Args;
use liveview::image::{encode, encode_gray16_png};
use liveview_files::npy;
use liveview_live::peak_memory;
use liveview_synthesizer::colormap::coloured;
use liveview_synthesizer::{DepthSource, ModelOptions, Scene, ScenePhotos, ViewDepth};
use serde_json::{Value, json};

use crate::args::{
    ADVANCED, SceneArgs, has_extension, held_out, named, numbers, refuse_stdout, refuse_twice, start_threads, stem,
    write_atomically,
};
use crate::console::{Output, path_text, print_notes, progress};
use crate::interrupt;
use crate::job::time_text;
use crate::outputs::OutputPlan;

const EXAMPLES: &str = "\
Examples:
  The depth of every photo, and the share of it that other photos confirm:
    liveview depth scene -o depth
  The depth of two photos, with a third held out, kept for a render:
    liveview depth scene --photo IMG_6.jpg,IMG_8.jpg --target IMG_7.jpg --cache kept -o depth
    liveview render scene --target IMG_7.jpg --layers surface:2 --cache kept -o new.png";

/// Options of `liveview depth`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct DepthArgs {
    /// Photos to write the depth of, by name [default: all that are not held out]
    #[arg(long, value_name = "NAME,…")]
    photo: Vec<String>,
    /// Views to hold out, by name, as in `render`: not used for the depth of other photos
    #[arg(long, value_name = "NAME,…", conflicts_with = "heldout")]
    target: Vec<String>,
    /// Hold out every Nth view, as in `render`
    #[arg(long, value_name = "N", value_parser = numbers::count)]
    heldout: Option<usize>,
    /// Keep the depth of photos in this folder, and reuse it in later runs
    ///
    /// The result is the same with and without it. You may delete any of its files (.npz, one per
    /// photo).
    #[arg(long, value_name = "FOLDER")]
    cache: Option<PathBuf>,
    /// Number of threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = numbers::up_to_256, help_heading = ADVANCED, hide_short_help = true)]
    threads: Option<usize>,
    /// Folder for the depth maps: disparity as 16-bit PNG, float32 array and colour picture
    ///
    /// NAME.png: 16-bit disparity, which is 1/depth; 0 to 65535 stand for 0 to the disparity_max in
    /// NAME_scale.json, in 1/scene unit; 0 is unconfirmed. NAME.npy: the same as float32; -1 is unconfirmed.
    /// NAME_colour.png: dark at far, light at near, black where unconfirmed.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    #[command(flatten)]
    scene: SceneArgs,
}

pub(crate) fn run(args: &DepthArgs) -> Result<Output> {
    let mut photos = ScenePhotos::new(args.scene.open()?);
    let scene = photos.views().scene();
    print_notes(&scene.notes);
    let (views, held_out) = views(args, scene)?;
    let all_files = planned_files(&args.output, args.cache.as_deref(), scene, &views)?;
    args.cache.iter().try_for_each(|folder| photos.keep_depths_in(folder)).context("--cache")?;
    start_threads(args.threads.unwrap_or_else(|| ModelOptions::default().threads_or_default()))?;
    let bar = progress()?.with_prefix("photos");
    bar.set_length(views.len() as u64);
    let stop = if views.len() > 1 { interrupt::watch()? } else { Arc::default() };
    let (mut rows, mut reports, mut range) = (Vec::new(), Vec::new(), (0.0, 0.0));
    for (index, (&view, files)) in views.iter().zip(&all_files).enumerate() {
        if stop.load(Ordering::Relaxed) {
            bar.finish_and_clear();
            return Err(interrupt::Interrupted.into());
        }
        let name = photos.views().scene().views[view].name.clone();
        bar.set_message(name.clone());
        let depth = photos.view_depth(view, &held_out, &views[index + 1..], false)?;
        write(files, &depth)?;
        bar.suspend(|| print_notes(&photos.take_notes()));
        range = depth.range;
        let (row, json) = report(&name, &depth, files);
        rows.push((name, row));
        reports.push(json);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let scene = photos.views().scene();
    let width = rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0).max(5);
    let mut text = format!("photos: {}, searched from {:.4} to {:.4} scene units\n", rows.len(), range.0, range.1);
    let _ = writeln!(text, "\n{:width$}  confirmed     nearest    farthest          time", "photo");
    for (name, row) in &rows {
        let _ = writeln!(text, "{name:width$}  {row}");
    }
    if rows.len() > 1 {
        let confirmed = reports.iter().filter_map(|report| report["confirmed"].as_f64()).sum::<f64>();
        let _ = writeln!(text, "{:width$}  {:7.1} %", "mean", 100.0 * confirmed / rows.len() as f64);
    }
    let _ = writeln!(text, "\nwrote {} files in {}", 4 * rows.len(), args.output.display());
    let json = json!({
        "scene": path_text(&scene.root), "near": range.0, "far": range.1,
        "held_out": held_out.iter().map(|&view| &scene.views[view].name).collect::<Vec<_>>(),
        "photos": reports, "peak_memory_bytes": peak_memory(), "notes": scene.notes,
    });
    Ok(Output { text, json })
}

/// The views to write, and those that are held out.
fn views(args: &DepthArgs, scene: &Scene) -> Result<(Vec<usize>, Vec<usize>)> {
    let held_out = held_out(scene, args.heldout, &args.target)?;
    let views = match args.photo.as_slice() {
        [] => (0..scene.views.len()).filter(|view| !held_out.contains(view)).collect(),
        names => named(scene, names)?,
    };
    refuse_twice("--photo", scene, &views)?;
    refuse_twice("--target", scene, &held_out)?;
    if let Some(&view) = views.iter().find(|view| held_out.contains(view)) {
        bail!("--photo \"{}\" is held out; expected a view that is not", scene.views[view].name);
    }
    if views.is_empty() {
        bail!("--target holds out every view; expected at least one that is not held out");
    }
    Ok((views, held_out))
}

/// Suffixes to the view's name: 16-bit PNG, its scale, float32 array, colour picture.
const SUFFIXES: [&str; 4] = [".png", "_scale.json", ".npy", "_colour.png"];

/// The files of each view, in a folder that is created; an error, before any work, if one cannot be
/// written.
fn planned_files(folder: &Path, cache: Option<&Path>, scene: &Scene, views: &[usize]) -> Result<Vec<[PathBuf; 4]>> {
    refuse_stdout("-o", folder)?;
    let shown = folder.display();
    if has_extension(folder, &["png", "npy", "npz", "json"]) && !folder.is_dir() {
        bail!("-o {shown}: expected a folder");
    }
    let mut output_plan = OutputPlan::new(scene);
    output_plan.folder("-o", folder)?;
    cache.map_or(Ok(()), |folder| output_plan.cache("--cache", folder))?;
    let mut all = Vec::with_capacity(views.len());
    for &view in views {
        let name = &scene.views[view].name;
        let files = SUFFIXES.map(|suffix| folder.join(stem(name) + suffix));
        files
            .iter()
            .try_for_each(|file| output_plan.named_file("-o", file))
            .with_context(|| format!("the depth of {name}"))?;
        all.push(files);
    }
    output_plan.prepare()?;
    Ok(all)
}

fn write(files: &[PathBuf; 4], depth: &ViewDepth) -> Result<()> {
    let known = &depth.confirmed.disparity;
    let (height, width) = known.dim();
    let (low, high) = ((1.0 / depth.range.1) as f32, (1.0 / depth.range.0) as f32);
    // The search extends half a plane beyond near.
    let largest = known.iter().copied().fold(high, f32::max);
    // At least 1 if confirmed, also at infinity: 0 means unconfirmed.
    let value = |&disparity: &f32| {
        if disparity < 0.0 { 0 } else { ((f64::from(disparity) / f64::from(largest) * 65535.0).round() as u16).max(1) }
    };
    let scale = json!({
        "liveview": env!("CARGO_PKG_VERSION"),
        "disparity": "value / 65535 * disparity_max = 1 / z, z along the camera's axis; 0: no other photo confirms it",
        "disparity_max": largest, "unit": "1/scene unit", "disparity_per_pixel_of_parallax": depth.found.disparity_per_pixel,
    });
    let colour = known.mapv(|disparity| if disparity < 0.0 { f32::NAN } else { disparity });
    let contents = [
        encode_gray16_png(width, height, &known.iter().map(value).collect::<Vec<_>>())?,
        format!("{scale:#}\n").into_bytes(),
        npy::bytes(known),
        encode("colour.png".as_ref(), &coloured(colour.view(), low, high))?,
    ];
    files.iter().zip(contents).try_for_each(|(file, contents)| write_atomically(file, &contents))
}

/// The report on the depth of a photo: a row of the table without the name, and JSON.
fn report(name: &str, depth: &ViewDepth, files: &[PathBuf; 4]) -> (String, Value) {
    let known = || depth.confirmed.disparity.iter().copied().filter(|&disparity| disparity >= 0.0);
    let (low, high) = known().fold((f32::INFINITY, 0.0_f32), |(low, high), value| (low.min(value), high.max(value)));
    let confirmed = depth.confirmed.share();
    let span = (low <= high).then(|| (1.0 / f64::from(high), 1.0 / f64::from(low)));
    let (nearest, farthest) = span.unzip();
    let cell = |depth: Option<f64>| depth.map_or_else(|| format!("{:>10}", "-"), |depth| format!("{depth:10.4}"));
    let (source, time) = match depth.source {
        DepthSource::Kept => ("kept", format!("{} kept", time_text(depth.time))),
        DepthSource::Alone => ("alone", "alone".to_owned()),
        _ => ("searched", time_text(depth.time)),
    };
    let row = format!("{:7.1} %  {}  {}  {time:>12}", 100.0 * confirmed, cell(nearest), cell(farthest));
    let json = json!({
        "name": name, "confirmed": confirmed, "nearest": nearest, "farthest": farthest,
        "disparity_per_pixel_of_parallax": depth.found.disparity_per_pixel, "source": source,
        "seconds": depth.time.as_secs_f64(), "files": files.iter().map(|file| path_text(file)).collect::<Vec<_>>(),
    });
    (row, json)
}
