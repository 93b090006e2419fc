//! `liveview render`.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Result;
use clap::Args;
use liveview::image::inpaint_unseen;
use liveview::image::{psnr, ssim};
use liveview::render::StageTimes;

use super::engine::ModelArgs;
use super::explain::{ExplainArgs, Explained, Explanation};
use super::layers::{LayerArgs, Recipe};
use super::output::{OutputArgs, Outputs, disparity_max};
use super::record;
use super::setup::{Job, Planned, SceneArgs, Shot};
use super::targets::TargetArgs;
use super::{Report, interrupt, progress, report};

const EXAMPLES: &str = "\
Examples:
  liveview render scene --target IMG_7.jpg -o new.png --compare compare.png
  liveview render scene --heldout 8 --guided 4 --compare compared/
  liveview render scene --target IMG_7.jpg --planes 64 -o new.png --depth disparity.png
  liveview render scene --target IMG_7.jpg -o new.png --explain why.png --dense 64
  liveview render scene --pose camera.json --near 1.5 --far 40 -o new.jpg
  liveview render scene --path circle:120 --select 16 --width 640 -o flight.mp4
  liveview render scene --path spiral:900 -o frames/
  liveview render scene --path spiral:900 -o frames/ --resume";

/// Pixels left out at each side of a picture when it is scored.
pub(crate) const SCORE_BORDER: usize = 16;

/// Options of `liveview render`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct RenderArgs {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    targets: TargetArgs,
    #[command(flatten)]
    layers: LayerArgs,
    #[command(flatten)]
    engine: ModelArgs,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    explain: ExplainArgs,
}

/// What there is to tell about one picture.
pub(super) struct Rendered {
    pub(super) shot: Shot,
    pub(super) layers: usize,
    /// None of a picture that was there.
    pub(super) times: Option<Times>,
    pub(super) score: Option<Score>,
    /// Share of the pixels that no view sees.
    pub(super) unseen: f64,
    pub(super) disparity_max: f32,
    pub(super) files: Vec<PathBuf>,
}

pub(super) struct Score {
    pub(super) psnr: f64,
    pub(super) ssim: f64,
}

/// Wall time of one picture, by stage.
pub(super) struct Times {
    /// Reading and decoding those photos that were not in memory yet.
    pub(super) photos: Duration,
    pub(super) coarse: Duration,
    pub(super) select: Duration,
    pub(super) stages: StageTimes,
}

pub(super) fn run(args: &RenderArgs) -> Result<Report> {
    let mut outputs = Outputs::new(&args.output, args.targets.have_truth())?;
    let photos = args.scene.open()?;
    photos.tell_notes();
    let mut job = Job::open(photos, &args.layers, &args.engine)?;
    let targets = args.targets.resolve(&job.photos)?;
    let moving = targets.moving;
    let shots = job.shots(targets)?;
    outputs.claim(&shots, &job.photos)?;
    args.explain.claim(&shots, &job.photos)?;
    outputs.begin(&shots, || record::fields(&job, &shots, &args.targets, &args.layers))?;
    job.progress = progress("layers")?;
    let wanted = shots.len();
    // One picture has nothing to end but itself.
    let stop = if wanted > 1 { interrupt::watch()? } else { Arc::default() };
    let rendered = render(&mut job, shots, moving, &mut outputs, &args.explain, &stop);
    job.progress.finish_and_clear();
    let (done, explanation) = rendered.inspect_err(|_| outputs.tell_how_to_go_on(wanted))?;
    let video = outputs.finish()?;
    Ok(report::rendered(&job, &done, moving, video, explanation))
}

/// Renders and writes all shots but those that are there.
fn render(
    job: &mut Job,
    mut shots: Vec<Shot>,
    moving: bool,
    outputs: &mut Outputs,
    explain: &ExplainArgs,
    stop: &AtomicBool,
) -> Result<(Vec<Rendered>, Option<Explanation>)> {
    // The paper's video: what the first frame selects serves the others.
    let shared = moving && matches!(job.recipe, Recipe::Select { .. });
    let mut done: Vec<Rendered> = Vec::with_capacity(shots.len());
    let (mut kept, mut explanation) = (None, None);
    shots.reverse();
    while let Some(shot) = shots.pop() {
        if let Some(there) = outputs.kept(&shot) {
            done.push(there);
            continue;
        }
        if stop.load(Ordering::Relaxed) {
            return Err(interrupt::Interrupted.into());
        }
        job.progress.set_message(shot.name.clone());
        let started = Instant::now();
        if let (true, None, Some(first)) = (shared, &kept, done.first()) {
            job.photos.load(&first.shot.views, &shots)?;
            kept = Some(job.layers(&first.shot)?.layers);
        }
        job.photos.load(&shot.views, &shots)?;
        let truth = shot.truth.map(|view| job.photos.scene.load_image(view)).transpose()?;
        let photos = started.elapsed();
        let Planned { layers, coarse, select, range } = match kept.take() {
            Some(layers) => Planned::known(layers),
            None => job.layers(&shot)?,
        };
        let mut frame = job.render(&shot, &layers)?;
        // Scored as it was rendered; filled for the eye.
        let score = truth.as_ref().map(|truth| Score {
            psnr: psnr(&frame.picture, truth, SCORE_BORDER),
            ssim: ssim(&frame.picture, truth, SCORE_BORDER),
        });
        let score = score.filter(|score| !score.psnr.is_nan() && !score.ssim.is_nan());
        if truth.is_some() && score.is_none() {
            super::tell("note", format!("{}: too small to be scored", shot.name));
        }
        let times = Times { photos, coarse, select, stages: frame.times };
        let about = Explained {
            shot: &shot,
            layers: &layers,
            range: range.as_ref(),
            frame: &frame,
            times: &times,
            truth: truth.as_ref(),
        };
        explanation = explain.explain(job, &about)?;
        frame.picture = inpaint_unseen(&frame.picture, &frame.transmittance);
        let digests = outputs.write(&shot, &frame, truth.as_ref())?;
        let pixels = frame.transmittance.len() as f64;
        let one = Rendered {
            layers: layers.len(),
            times: Some(times),
            score,
            unseen: frame.transmittance.iter().map(|&left| f64::from(left)).sum::<f64>() / pixels,
            disparity_max: disparity_max(&frame),
            files: outputs.files(&shot),
            shot,
        };
        outputs.written(&one, digests)?;
        done.push(one);
        kept = Some(layers).filter(|_| shared);
    }
    Ok((done, explanation))
}
