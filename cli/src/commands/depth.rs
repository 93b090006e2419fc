//! `liveview depth`: the depth of the photos, as pictures and as numbers, scored if the scene has
//! true depth.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use liveview::image::{self, encode, encode_gray16_png};
use liveview_files::{bounded, npy};
use liveview_live::peak_memory;
use liveview_scene::View;
use liveview_synthesizer::colormap::coloured;
use liveview_synthesizer::{DepthSource, ModelOptions, Scene, ScenePhotos, ViewDepth};
use ndarray::Array2;
use serde_json::{Value, json};

use crate::args::{
    ADVANCED, SceneArgs, has_extension, held_out, named, numbers, refuse_stdout, refuse_twice, start_threads, stem,
    write_atomically,
};
use crate::console::{Output, path_text, print_message, print_notes, progress};
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
    let truth = Truth::open(scene).unwrap_or_else(|error| {
        print_message("note", format!("the depth is not scored: {error:#}"));
        None
    });
    let all_files = planned_files(&args.output, args.cache.as_deref(), scene, &views, truth.as_ref())?;
    args.cache.iter().try_for_each(|folder| photos.keep_depths_in(folder)).context("--cache")?;
    start_threads(args.threads.unwrap_or_else(|| ModelOptions::default().threads_or_default()))?;
    let bar = progress()?.with_prefix("photos");
    bar.set_length(views.len() as u64);
    let stop = if views.len() > 1 { interrupt::watch()? } else { Arc::default() };
    let (mut reports, mut range) = (Vec::with_capacity(views.len()), (0.0, 0.0));
    for (index, (&view, files)) in views.iter().zip(all_files).enumerate() {
        if stop.load(Ordering::Relaxed) {
            bar.finish_and_clear();
            return Err(interrupt::Interrupted.into());
        }
        bar.set_message(photos.views().scene().views[view].name.clone());
        let depth = photos.view_depth(view, &held_out, &views[index + 1..])?;
        write(&files, &depth)?;
        let shown = &photos.views().scene().views[view];
        let score = truth.as_ref().map_or(Ok(None), |truth| truth.score(shown, &depth));
        let score = score.unwrap_or_else(|error| {
            bar.suspend(|| print_message("note", format!("the depth is not scored: {error:#}")));
            None
        });
        let name = shown.name.clone();
        bar.suspend(|| print_notes(&photos.take_notes()));
        range = depth.range;
        reports.push(Report::new(name, &depth, score, files));
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(report(photos.views().scene(), &reports, range, &held_out))
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
fn planned_files(
    folder: &Path,
    cache: Option<&Path>,
    scene: &Scene,
    views: &[usize],
    truth: Option<&Truth>,
) -> Result<Vec<[PathBuf; 4]>> {
    refuse_stdout("-o", folder)?;
    let shown = folder.display();
    if has_extension(folder, &["png", "npy", "npz", "json"]) && !folder.is_dir() {
        bail!("-o {shown}: expected a folder");
    }
    let same = |other: &Path| folder.canonicalize().is_ok_and(|folder| other.canonicalize().is_ok_and(|o| o == folder));
    if truth.is_some_and(|truth| same(&truth.folder)) {
        bail!("-o {shown}: would overwrite the true depth of the scene; expected another folder");
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

/// The report on the depth of the photos, as text and as JSON.
fn report(scene: &Scene, reports: &[Report], (near, far): (f64, f64), held_out: &[usize]) -> Output {
    let scored = reports.iter().any(|one| one.score.is_some());
    let width = reports.iter().map(|one| one.name.chars().count()).max().unwrap_or(0).max(5);
    let mut text = format!("photos: {}, searched from {near:.4} to {far:.4} scene units\n", reports.len());
    if scored {
        let bounds = WITHIN.map(|bound| format!("{bound}")).join(", ");
        let _ = writeln!(
            text,
            "shares of pixels within {bounds} pixels of parallax of the truth: of the confirmed | of all pixels"
        );
    }
    let truth = if scored { format!("  {:^20} | {:^20}", "confirmed", "all") } else { String::new() };
    let _ = writeln!(text, "\n{:width$}  confirmed     nearest    farthest          time{truth}", "photo");
    for Report { name, source, seconds, confirmed, span, score, .. } in reports {
        let span = match *span {
            Some((nearest, farthest)) => format!("{nearest:10.4}  {farthest:10.4}"),
            None => format!("{:>10}  {:>10}", "-", "-"),
        };
        let time = match source {
            DepthSource::Kept => format!("{} kept", time_text(Duration::from_secs_f64(*seconds))),
            DepthSource::Alone => "alone".to_owned(),
            _ => time_text(Duration::from_secs_f64(*seconds)),
        };
        let score = score.as_ref().map(|score| format!("  {}", cells(score))).unwrap_or_default();
        let _ = writeln!(text, "{name:width$}  {:7.1} %  {span}  {time:>12}{score}", 100.0 * confirmed);
    }
    let mean = mean(reports);
    if let (Some(mean), true) = (&mean, reports.len() > 1) {
        let confirmed = reports.iter().map(|one| one.confirmed).sum::<f64>() / reports.len() as f64;
        let _ = writeln!(text, "{:width$}  {:7.1} %  {:36}  {}", "mean", 100.0 * confirmed, "", cells(mean));
    }
    if let [first, ..] = reports {
        let folder = first.files[0].parent().unwrap_or(Path::new(""));
        let _ = writeln!(text, "\nwrote {} files in {}", 4 * reports.len(), folder.display());
    }
    let json = json!({
        "scene": path_text(&scene.root), "near": near, "far": far,
        "held_out": held_out.iter().map(|&view| &scene.views[view].name).collect::<Vec<_>>(),
        "photos": reports.iter().map(photo).collect::<Vec<_>>(), "within_pixels": WITHIN, "mean": mean.as_ref().map(shares),
        "peak_memory_bytes": peak_memory(), "notes": scene.notes,
    });
    Output { text, json }
}

fn photo(report: &Report) -> Value {
    let Report { name, source, seconds, confirmed, span, disparity_per_pixel, score, files } = report;
    let source = match source {
        DepthSource::Kept => "kept",
        DepthSource::Alone => "alone",
        _ => "searched",
    };
    json!({
        "name": name, "confirmed": confirmed, "nearest": span.map(|span| span.0), "farthest": span.map(|span| span.1),
        "disparity_per_pixel_of_parallax": disparity_per_pixel, "source": source, "seconds": seconds,
        "within": score.as_ref().map(shares), "files": files.iter().map(|file| path_text(file)).collect::<Vec<_>>(),
    })
}

fn shares(score: &Score) -> Value {
    json!({ "confirmed": score.confirmed, "all": score.all })
}

fn cells(score: &Score) -> String {
    let [confirmed, all] =
        [score.confirmed, score.all].map(|shares| shares.map(|share| format!("{:4.1} %", 100.0 * share)).join(" "));
    format!("{confirmed:>20} | {all:>20}")
}

/// The mean of the photos that have a score.
fn mean(reports: &[Report]) -> Option<Score> {
    let scores: Vec<&Score> = reports.iter().filter_map(|one| one.score.as_ref()).collect();
    let mean = |of: fn(&Score) -> [f64; 3]| {
        std::array::from_fn(|k| scores.iter().map(|score| of(score)[k]).sum::<f64>() / scores.len() as f64)
    };
    (!scores.is_empty()).then(|| Score { confirmed: mean(|score| score.confirmed), all: mean(|score| score.all) })
}

/// The report on a photo's depth.
struct Report {
    name: String,
    source: DepthSource,
    seconds: f64,
    /// Share of the pixels that other photos confirm, 0 to 1.
    confirmed: f64,
    /// Nearest and farthest confirmed depth, in scene units.
    span: Option<(f64, f64)>,
    /// Disparity of one pixel of parallax, in 1/scene unit.
    disparity_per_pixel: f32,
    score: Option<Score>,
    files: [PathBuf; 4],
}

impl Report {
    fn new(name: String, depth: &ViewDepth, score: Option<Score>, files: [PathBuf; 4]) -> Self {
        let confirmed = || depth.confirmed.disparity.iter().copied().filter(|&disparity| disparity >= 0.0);
        let (low, high) =
            confirmed().fold((f32::INFINITY, 0.0_f32), |(low, high), value| (low.min(value), high.max(value)));
        let count = confirmed().count();
        Self {
            name,
            source: depth.source,
            seconds: depth.time.as_secs_f64(),
            confirmed: count as f64 / depth.confirmed.disparity.len() as f64,
            span: (count > 0).then(|| (1.0 / f64::from(high), 1.0 / f64::from(low))),
            disparity_per_pixel: depth.found.disparity_per_pixel,
            score,
            files,
        }
    }
}

/// Error bounds of the reported shares, in pixels of parallax.
const WITHIN: [f32; 3] = [0.5, 1.0, 2.0];

/// The true depth of a scene.
struct Truth {
    folder: PathBuf,
    delta_max: f64,
}

/// Shares (0 to 1) of the pixels within [`WITHIN`] pixels of parallax of the truth, among those
/// with known truth.
#[derive(Clone, Copy)]
struct Score {
    confirmed: [f64; 3],
    all: [f64; 3],
}

impl Truth {
    /// Opens the true depth of a scene, if it has any.
    fn open(scene: &Scene) -> Result<Option<Self>> {
        let folder = scene.root.join("depth");
        let path = folder.join("scale.json");
        if !path.is_file() {
            return Ok(None);
        }
        let text = bounded::read_text(&path, bounded::MAX_JSON_BYTES).with_context(|| path.display().to_string())?;
        let scale: Value = serde_json::from_slice(&text).map_err(|error| anyhow!("{}: {error}", path.display()))?;
        match scale["delta_max"].as_f64() {
            Some(delta_max) if delta_max > 0.0 => Ok(Some(Self { folder, delta_max })),
            _ => bail!("{}: \"delta_max\" is {}; expected a number above 0", path.display(), scale["delta_max"]),
        }
    }

    /// Compares a photo's depth with the truth, if the photo has one.
    fn score(&self, view: &View, depth: &ViewDepth) -> Result<Option<Score>> {
        let path = self.folder.join(stem(&view.name) + ".png");
        if !path.is_file() {
            return Ok(None);
        }
        let picture = image::load(&path)?;
        let (actual, expected) = (picture.size(), view.camera.size());
        if actual != expected {
            bail!("{}: {actual}; expected {expected}, the size of the photo", path.display());
        }
        let truth = |(y, x)| (f64::from(picture.pixel(x, y)[0]) * self.delta_max) as f32;
        Ok(Some(score(depth, &Array2::from_shape_fn(depth.found.disparity.dim(), truth))))
    }
}

fn score(depth: &ViewDepth, truth: &Array2<f32>) -> Score {
    // The pixels within each bound, then all pixels.
    let (mut known, mut confirmed) = ([0_usize; 4], [0_usize; 4]);
    for ((found, confirmed_disparity), &truth) in
        depth.found.disparity.iter().zip(&depth.confirmed.disparity).zip(truth)
    {
        if truth > 0.0 {
            let error = (found - truth).abs() / depth.found.disparity_per_pixel;
            let count = |counts: &mut [usize; 4]| {
                counts[3] += 1;
                WITHIN.iter().zip(counts).for_each(|(&bound, count)| *count += usize::from(error <= bound));
            };
            count(&mut known);
            if *confirmed_disparity >= 0.0 {
                count(&mut confirmed);
            }
        }
    }
    let shares = |counts: [usize; 4]| std::array::from_fn(|k| counts[k] as f64 / counts[3].max(1) as f64);
    Score { confirmed: shares(confirmed), all: shares(known) }
}
