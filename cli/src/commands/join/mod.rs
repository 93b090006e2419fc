//! `liveview join`: combines the pictures of all shards of a job into one video or one table.

mod shards;

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::Args;
use liveview::image::{self, Score};
use liveview_common::args::frame_rate::{FrameRate, frame_rate};
use liveview_common::args::output::{has_extension, refuse_stdout, write_atomically};
use liveview_common::console::{Output, path_text};
use liveview_common::ffmpeg::{Encoder, is_video};
use liveview_common::interrupt::{self, Interrupted};
use liveview_common::outputs::OutputPlan;
use serde_json::{Value, json};
use shards::{Picture, RecordFile};

use crate::commands::render::{EXPECTED_COVERAGE, is_blank, warn_of_blank};

const EXAMPLES: &str = "\
Examples:
  liveview join frames/ -o flight.mp4
  liveview join machine_1/ machine_2/ -o scores.json
  liveview join frames/";

/// Options of `liveview join`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct JoinArgs {
    /// Folders with the pictures of all shards of one job
    #[arg(required = true, value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// Video (.mp4, .gif; needs ffmpeg) or table of scores (.json) to write [default: only check
    /// the pictures]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Frames per second of a video
    #[arg(long, value_name = "N", default_value = "30", value_parser = frame_rate)]
    fps: FrameRate,
}

pub(crate) fn run(args: &JoinArgs) -> Result<Output> {
    interrupt::watch(Vec::new())?;
    let mut encoder = None;
    if let Some(path) = &args.output {
        refuse_stdout("-o", path)?;
        if is_video(path) {
            encoder = Some(Encoder::new(path, args.fps)?);
        } else if path.is_dir() || !has_extension(path, &["json"]) {
            bail!("-o {}: expected a name that ends in .mp4, .gif or .json", path.display());
        }
    }
    let records = shards::read(&args.folders)?;
    let output_plan = plan_output(args.output.as_deref(), &records)?;
    shards::check_one_job(&records)?;
    let pictures = shards::pictures(&records)?;
    check_coverage(&pictures)?;
    output_plan.prepare()?;
    let output = table(args, &records, &pictures);
    match (encoder, &args.output) {
        (Some(encoder), _) => video(encoder, &pictures)?,
        (None, Some(path)) => write_atomically(path, format!("{:#}\n", output.json).as_bytes())?,
        (None, None) => {}
    }
    Ok(output)
}

/// Checks that the output overwrites no record, no picture and no file of the scene.
fn plan_output(output: Option<&Path>, records: &[RecordFile]) -> Result<OutputPlan> {
    let mut output_plan = OutputPlan::default();
    let Some(output) = output else { return Ok(output_plan) };
    for record in records {
        output_plan.protect("the record of a shard,", Some(&record.path));
        record.files().for_each(|file| output_plan.protect("a picture of a shard,", Some(&file)));
    }
    // The scene may lie on another machine.
    let scenes = records.iter().filter_map(|record| record.record.job.get("scene")?.as_str());
    scenes.for_each(|scene| output_plan.add_scene_folder(scene.as_ref()));
    output_plan.file("-o", output)?;
    Ok(output_plan)
}

/// As in a single run: an error if all pictures are blank, a warning if some are.
fn check_coverage(pictures: &[Picture]) -> Result<()> {
    let blank = |picture: &&Picture| picture.entry["uncovered_share"].as_f64().is_some_and(is_blank);
    let blank: Vec<&Picture> = pictures.iter().filter(blank).collect();
    match blank.first() {
        None => {}
        Some(_) if blank.len() == pictures.len() => bail!("no view covers any of the pictures; {EXPECTED_COVERAGE}"),
        Some(first) => warn_of_blank(blank.len(), pictures.len(), &first.name),
    }
    Ok(())
}

fn video(mut encoder: Encoder, pictures: &[Picture]) -> Result<()> {
    let mut size = None;
    for picture in pictures {
        if interrupt::requested() {
            return Err(Interrupted.into());
        }
        let loaded = image::load(&picture.file)?;
        let first = *size.get_or_insert_with(|| loaded.size());
        if loaded.size() != first {
            let (at, file, size) = (encoder.path().display(), picture.file.display(), loaded.size());
            bail!(
                "-o {at}: {file} is {}x{}, the pictures before it {}x{}; expected one size in a video",
                size.width,
                size.height,
                first.width,
                first.height
            );
        }
        encoder.add(&loaded)?;
    }
    encoder.finish().map(drop)
}

/// Each picture's score, and their mean.
fn table(args: &JoinArgs, records: &[RecordFile], pictures: &[Picture]) -> Output {
    let number = |picture: &Picture, key: &str| picture.entry[key].as_f64();
    let scored = || pictures.iter().filter_map(|picture| number(picture, "psnr").zip(number(picture, "ssim")));
    let count = scored().count();
    let (psnr, ssim) = scored().fold((0.0, 0.0), |sum, score| (sum.0 + score.0, sum.1 + score.1));
    let mean = (count > 0).then(|| (psnr / count as f64, ssim / count as f64));
    let mut text = format!("{} pictures of {} shards, complete\n", pictures.len(), shards::count(records));
    if let Some((psnr, ssim)) = mean {
        let width = pictures.iter().map(|picture| picture.name.chars().count()).max().unwrap_or(0).max(4);
        let _ = writeln!(text, "\n{:width$}  PSNR dB    SSIM", "view");
        for picture in pictures {
            let [psnr, ssim] = ["psnr", "ssim"].map(|key| number(picture, key).unwrap_or(f64::NAN));
            let _ = writeln!(text, "{:width$}  {psnr:7.2}  {ssim:6.4}", picture.name);
        }
        let border = Score::BORDER;
        let _ = writeln!(text, "{:width$}  {psnr:7.2}  {ssim:6.4}  ({border}-pixel border excluded)", "mean");
    }
    if let Some(path) = &args.output {
        let _ = writeln!(text, "wrote   {}", path.display());
    }
    let target = |picture: &Picture| {
        let mut json = json!({ "name": picture.name, "file": path_text(&picture.file) });
        for key in ["layers", "psnr", "ssim", "uncovered_share", "occluded_share", "disparity_max"] {
            json[key] = picture.entry[key].clone();
        }
        json
    };
    let json = json!({
        "liveview": env!("CARGO_PKG_VERSION"), "job": records[0].record.job, "shards": shards::count(records),
        "targets": pictures.iter().map(target).collect::<Vec<Value>>(),
        "mean": mean.map(|(psnr, ssim)| json!({ "psnr": psnr, "ssim": ssim })), "excluded_border": Score::BORDER,
        "output": args.output.as_deref().map(path_text),
    });
    Output { text, json }
}
