//! `liveview depth`: the depth of the photos, as pictures and as numbers, scored if the scene has
//! true depth.

mod files;
mod report;
mod table;
mod truth;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use crate::args::ADVANCED;
use crate::args::model::start_threads;
use crate::args::numbers;
use crate::args::scene::SceneArgs;
use crate::args::targets::{held_out, named, refuse_twice};
use crate::console::{Output, print_message, print_notes, progress};
use crate::interrupt;
use anyhow::{Context, Result, bail};
use clap::Args;
use liveview::{ModelOptions, Scene, ScenePhotos};
use report::{Report, ViewDepthSummary};
use truth::Truth;

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
    let all_files = files::planned(&args.output, args.cache.as_deref(), scene, &views, truth.as_ref())?;
    args.cache.iter().try_for_each(|folder| photos.keep_depths_in(folder)).context("--cache")?;
    start_threads(args.threads.unwrap_or_else(|| ModelOptions::default().threads_or_default()))?;
    let bar = progress("photos")?;
    bar.set_length(views.len() as u64);
    let stop = if views.len() > 1 { interrupt::watch(Vec::new())? } else { Arc::default() };
    let (mut reports, mut range) = (Vec::with_capacity(views.len()), (0.0, 0.0));
    for (index, (&view, files)) in views.iter().zip(all_files).enumerate() {
        if stop.load(Ordering::Relaxed) {
            bar.finish_and_clear();
            return Err(interrupt::Interrupted.into());
        }
        bar.set_message(photos.views().scene().views[view].name.clone());
        let depth = photos.view_depth(view, &held_out, &views[index + 1..])?;
        files::write(&files, &depth)?;
        let shown = &photos.views().scene().views[view];
        let score = truth.as_ref().map_or(Ok(None), |truth| truth.score(shown, &depth));
        let score = score.unwrap_or_else(|error| {
            bar.suspend(|| print_message("note", format!("the depth is not scored: {error:#}")));
            None
        });
        let name = shown.name.clone();
        bar.suspend(|| print_notes(&photos.take_notes()));
        range = depth.range;
        reports.push(Report { name, depth: ViewDepthSummary::of(&depth), score, files });
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(table::output(photos.views().scene(), &reports, range, &held_out))
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
