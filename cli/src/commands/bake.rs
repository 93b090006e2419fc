//! `liveview bake`: a scene as one page that opens from a file.

use std::path::PathBuf;
use std::sync::atomic::Ordering;

use anyhow::{Context, Result};
use clap::Args;
use liveview_synthesizer::{ModelOptions, ScenePhotos};
use serde_json::json;

use crate::args::{SceneArgs, held_out, numbers, refuse_stdout, start_threads, write_atomically};
use crate::console::{Output, path_text, print_notes, progress};
use crate::interrupt;
use crate::outputs::OutputPlan;

/// Width to which photos are scaled down unless `--width` is given.
const WIDTH: usize = 640;

const EXAMPLES: &str = "\
Examples:
  liveview bake scene -o page.html
  liveview bake scene --width 480 --max-mb 3 -o page.html";

/// Options of `liveview bake`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct BakeArgs {
    /// Photos to compare with and not to draw from, by name
    #[arg(long, value_name = "NAME,…", conflicts_with = "heldout")]
    target: Vec<String>,
    /// Hold out every Nth photo
    #[arg(long, value_name = "N", value_parser = numbers::count)]
    heldout: Option<usize>,
    /// Largest size of the page, in millions of bytes
    ///
    /// Quality goes down first; then photos are left out, which is said.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = numbers::count)]
    max_mb: usize,
    /// Keep the depth of photos in this folder, and reuse it in later runs
    #[arg(long, value_name = "FOLDER")]
    cache: Option<PathBuf>,
    /// File for the page
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    scene: SceneArgs,
}

pub(crate) fn run(args: &BakeArgs) -> Result<Output> {
    let mut photos = ScenePhotos::new(args.scene.open_at(Some(WIDTH), args.scene.depth())?);
    let scene = photos.views().scene();
    print_notes(&scene.notes);
    let held_out = scene.with_held_out(held_out(scene, args.heldout, &args.target)?);
    refuse_stdout("-o", &args.output)?;
    let mut output_plan = OutputPlan::new(scene);
    output_plan.file("-o", &args.output)?;
    args.cache.iter().try_for_each(|folder| output_plan.cache("--cache", folder))?;
    output_plan.prepare()?;
    args.cache.iter().try_for_each(|folder| photos.keep_depths_in(folder)).context("--cache")?;
    start_threads(ModelOptions::default().threads_or_default())?;
    let bar = progress()?.with_prefix("photos");
    bar.set_length((photos.views().scene().views.len() - held_out.len()) as u64);
    let stop = interrupt::watch()?;
    let baked = liveview_viewer::bake(&mut photos, &held_out, args.max_mb.saturating_mul(1_000_000), |count| {
        bar.set_position(count as u64);
        if stop.load(Ordering::Relaxed) { Err(interrupt::Interrupted.into()) } else { Ok(()) }
    });
    bar.finish_and_clear();
    let baked = baked?;
    print_notes(&photos.take_notes());
    print_notes(&baked.notes);
    write_atomically(&args.output, baked.html.as_bytes())?;
    let (shown, bytes) = (args.output.display(), baked.html.len());
    let text = format!("wrote {shown}: {} photos, {:.1} MB; open it in a browser\n", baked.photos, bytes as f64 / 1e6);
    let json = json!({ "file": path_text(&args.output), "photos": baked.photos, "bytes": bytes, "notes": baked.notes });
    Ok(Output { text, json })
}
