//! `liveview render`: new views of a scene, scored if the photo exists.

mod explain;
mod outputs;
mod summary;

use std::collections::VecDeque;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Error, Result, anyhow, bail};
use clap::Args;
use liveview_synthesizer::{LayerSpec, Plan, Score, Shot, agreement, guessed};

use crate::args::{
    ADVANCED, LayerArgs, MORE_HELP, ModelArgs, SceneArgs, TargetArgs, expect_png, named, numbers, write_atomically,
};
use crate::console::{Output, escaped, print_message, print_notes};
use crate::interrupt::{self, Interrupted};
use crate::job::{Job, Times};
use crate::outputs::OutputPlan;
use explain::Explained;
use outputs::{OutputArgs, Outputs, disparity_max};
use summary::Rendered;

pub(crate) fn run(args: &RenderArgs) -> Result<Output> {
    let mut outputs = Outputs::new(&args.output, args.targets.have_truth())?;
    summary::check_scores(args.scores.as_deref(), args.targets.have_truth())?;
    let photos = args.scene.open()?;
    print_notes(&photos.scene().notes);
    let mut job = Job::open(photos, &args.layers, &args.model)?;
    let mut targets = args.targets.resolve(job.synthesizer.views())?;
    if let Some(degrees) = args.fov {
        for target in &mut targets.list {
            target.camera = target.camera.with_field_of_view(degrees)?;
        }
    }
    targets.held_out.extend(named(job.synthesizer.scene(), &args.holdout)?);
    let moving = targets.moving;
    let all = job.synthesizer.shots(targets)?;
    let mut frames = args.frames.clone().unwrap_or(0..all.len());
    if frames.end == usize::MAX {
        frames.end = all.len();
    }
    if frames.end > all.len() || frames.is_empty() {
        bail!("--frames {}:{}: the path has {} frames; expected B up to {2}", frames.start, frames.end, all.len());
    }
    let shots = all[frames.clone()].to_vec();
    let mut output_plan = OutputPlan::new(job.synthesizer.scene());
    let (option, file) = args.targets.camera_file();
    output_plan.protect(option, file);
    args.model.protect(&mut output_plan, job.model.path());
    let pictures: Vec<_> = shots.iter().map(|shot| (shot.name.as_str(), shot.target.size())).collect();
    outputs.plan_outputs(&pictures, &mut output_plan)?;
    args.scores.iter().try_for_each(|file| output_plan.file("--scores", file))?;
    if let Some(file) = &args.explain {
        if pictures.len() != 1 {
            bail!("--explain {}: {} pictures are rendered; expected one target", file.display(), pictures.len());
        }
        expect_png("--explain", file)?;
        output_plan.file("--explain", file)?;
    }
    output_plan.prepare()?;
    let wanted = shots.len();
    job.show_progress(wanted)?;
    // If there is only one picture, Ctrl-C ends the program at once.
    let stop = if wanted > 1 { interrupt::watch()? } else { Arc::default() };
    let rendered = render(&mut job, shots, &all, moving, &mut outputs, args, &stop);
    job.progress.finish_and_clear();
    // An error after an interrupt, such as a network run that was ended, is reported as the
    // interrupt.
    let rendered = rendered.map_err(|error| if interrupt::requested() { Interrupted.into() } else { error });
    let (done, explanation) = rendered.inspect_err(|_| {
        if let (Some(folder), written @ 1..) = (outputs.folder(), outputs.written) {
            let rest = format!("; --frames {}:{} renders the rest", frames.start + written, frames.end);
            let rest = if moving { rest } else { String::new() };
            print_message("note", format!("{written} of {wanted} pictures are in {}{rest}", folder.display()));
        }
    })?;
    check_coverage(&done, args)?;
    let shares: Vec<f64> = done.iter().filter_map(|one| one.agreeing_share).collect();
    if let Some(warning) = agreement::warning(shares.iter().sum::<f64>() / shares.len() as f64) {
        print_message("warning", warning);
    }
    let video = outputs.finish()?;
    let share = args.frames.as_ref().map(|_| (frames.clone(), all.len()));
    let mut output = summary::rendered(&job, &done, moving, share, video, explanation);
    if let Some(file) = &args.scores {
        write_atomically(file, summary::csv(&done).as_bytes())?;
        output.text += &format!("wrote   {}\n", file.display());
    }
    Ok(output)
}

/// The expectation in errors about blank pictures.
const EXPECTED_COVERAGE: &str =
    "expected a viewpoint that faces the same way as the views, or another --near and --far";

/// Whether no view covers a picture, given the share of it that no view covers.
fn is_blank(uncovered_share: f64) -> bool {
    uncovered_share > 1.0 - 1e-6
}

/// An error if all pictures of the job are blank, a warning if some are.
fn check_coverage(done: &[Rendered], args: &RenderArgs) -> Result<()> {
    let blank = done.iter().filter(|one| is_blank(one.uncovered_share));
    let blank: Vec<&str> = blank.map(|one| one.shot.name.as_str()).collect();
    match blank.as_slice() {
        [] => {}
        all if all.len() == done.len() && args.frames.is_none() => return Err(no_coverage(args)),
        [first, ..] => {
            let (count, total) = (blank.len(), done.len());
            let which = format!("no view covers {count} of {total} pictures, which are blank: {first} first");
            print_message("warning", which);
        }
    }
    Ok(())
}

fn no_coverage(args: &RenderArgs) -> Error {
    let (option, file) = args.targets.camera_file();
    let from = file.map(|file| format!(", {option} {}", file.display())).unwrap_or_default();
    anyhow!("{}{from}: no view covers any of the targets; {EXPECTED_COVERAGE}", args.scene.folder().display())
}

/// Renders and writes `shots`, out of `all` shots of the job.
fn render(
    job: &mut Job,
    shots: Vec<Shot>,
    all: &[Shot],
    moving: bool,
    outputs: &mut Outputs,
    args: &RenderArgs,
    stop: &AtomicBool,
) -> Result<(Vec<Rendered>, Option<Output>)> {
    // As in the paper's video, all frames use the planes that the first one selects.
    let shared = moving && matches!(job.synthesizer.layers(), LayerSpec::Select { .. });
    let mut done: Vec<Rendered> = Vec::with_capacity(shots.len());
    let (mut kept, mut explanation): (Option<Plan>, _) = (None, None);
    let single = all.len() == 1;
    let mut shots = VecDeque::from(shots);
    while let Some(shot) = shots.pop_front() {
        let later = &*shots.make_contiguous();
        if stop.load(Ordering::Relaxed) {
            return Err(Interrupted.into());
        }
        job.progress.set_message(escaped(&shot.name));
        let started = Instant::now();
        if let (true, None, first) = (shared && shot.name != all[0].name, &kept, &all[0]) {
            let first = job.synthesizer.load(first, later)?;
            kept = Some(job.plan(&first)?);
        }
        let loaded = job.synthesizer.load(&shot, later)?;
        let truth = shot.truth.map(|view| job.synthesizer.scene().load_image(view)).transpose()?;
        let photos = started.elapsed();
        let plan = match kept.take() {
            Some(plan) => job.synthesizer.plan_on(&loaded, plan.layers)?,
            None => job.plan(&loaded)?,
        };
        let frame = job.render(&loaded, &plan)?;
        let scores = truth.as_ref().map(|truth| Score::of_delivered(&frame, truth));
        let (score, psnr_covered) = scores.unwrap_or_default();
        if truth.is_some() && score.is_none() {
            print_message("note", format!("{}: not scored, the picture is too small", shot.name));
        }
        let weighting = job.model.weighting_stage();
        let times = Times { photos, depth: plan.search, select: plan.selection, weighting, stages: frame.times };
        let about = Explained { shot: &shot, plan: &plan, frame: &frame, times: &times };
        let pixels = frame.transmittance.len() as f64;
        let uncovered_share = frame.uncovered_share();
        if single && is_blank(uncovered_share) {
            return Err(no_coverage(args));
        }
        explanation = args.explain.as_ref().map(|file| explain::explain(file, job, &about)).transpose()?;
        outputs.write(&shot, &frame, truth.as_ref())?;
        if frame.logits_not_finite > 0 {
            let count = frame.logits_not_finite;
            let note = format!("{}: {count} logits of the network are NaN or infinite", shot.name);
            job.progress.suspend(|| print_message("note", note));
        }
        let one = Rendered {
            layers: plan.layers.len(),
            times,
            score,
            psnr_covered,
            uncovered_share,
            guessed_share: plan.surface.as_ref().map(|found| found.surface.guessed_share()),
            advice: guessed::advice(job.synthesizer.views(), &shot, &plan, &frame),
            occluded_share: frame.occluded_pixels as f64 / pixels,
            confirmed_share: plan.surface.as_ref().map(|surface| surface.confirmed_share),
            agreeing_share: job.agreeing_share,
            disparity_max: disparity_max(&frame),
            files: outputs.files(&shot),
            shot,
        };
        done.push(one);
        kept = Some(plan).filter(|_| shared);
    }
    Ok((done, explanation))
}

const EXAMPLES: &str = "\
Examples:
  liveview render scene --target IMG_7.jpg -o new.png --compare compare.png
  liveview render scene --target IMG_7.jpg -o new.png --explain why.png
  liveview render scene --path interpolate:300:a.jpg,b.jpg,c.jpg --fov 50 -o flight.mp4
  liveview render scene --path spiral:900 -o frames/ --frames 100:200";

/// Options of `liveview render`, in the order of the help.
#[derive(Debug, Args)]
#[command(after_help = MORE_HELP, after_long_help = EXAMPLES)]
pub(crate) struct RenderArgs {
    #[command(flatten)]
    targets: TargetArgs,
    /// Horizontal field of view of the pictures of --pose and --path [default: the photos']
    #[arg(long, value_name = "DEGREES", value_parser = numbers::field_of_view, conflicts_with_all = ["target", "heldout"])]
    fov: Option<f64>,
    /// With --pose or --path: photos to leave out of the rendering, by name
    #[arg(long, value_name = "NAME,…", conflicts_with_all = ["target", "heldout"])]
    holdout: Vec<String>,
    #[command(flatten)]
    output: OutputArgs,
    /// Also write a table of the scores, a line per picture
    ///
    /// Columns: name, psnr (dB), ssim, psnr_covered (of the covered pixels, where some are not), uncovered_share,
    /// occluded_share and guessed_share (0 to 1), seconds. Empty
    /// where it is unknown: the score of a picture that is too small.
    #[arg(long, value_name = "CSV")]
    scores: Option<PathBuf>,
    #[command(flatten)]
    layers: LayerArgs,
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    model: ModelArgs,
    /// Render only the frames A up to but without B of the path, counted from 0: the share of one machine
    ///
    /// They are the same as in the whole path, and have the same names: several runs can write to one folder.
    #[arg(long, value_name = "A:B", value_parser = numbers::frame_range, conflicts_with_all = ["target", "heldout", "pose"])]
    #[arg(help_heading = ADVANCED, hide_short_help = true)]
    frames: Option<Range<usize>>,
    /// Print which layers were used and skipped and where the time went, and draw the layers; for
    /// one target
    ///
    /// The picture shows the disparity of surface layers, the plane of each pixel, or the nearest
    /// disparity, farthest disparity and parallax of guided layers.
    #[arg(long, value_name = "PNG", help_heading = ADVANCED, hide_short_help = true)]
    explain: Option<PathBuf>,
}
