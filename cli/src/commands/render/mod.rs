//! `liveview render`: new views of a scene, scored where the photo exists.

mod explain;
mod outputs;
mod record;
mod rendered;
mod summary;

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Error, Result, anyhow};
use clap::Args;
use explain::{ExplainArgs, Explained, Explanation};
use liveview::image::{Score, inpaint_unseen};
use liveview::{LayerSpec, Plan, Shot};
use outputs::{OutputArgs, Outputs, disparity_max};
use rendered::Rendered;

use crate::args::layers::LayerArgs;
use crate::args::model::ModelArgs;
use crate::args::scene::SceneArgs;
use crate::args::targets::TargetArgs;
use crate::console::{Output, escaped, print_message, print_notes, progress};
use crate::interrupt::{self, Interrupted};
use crate::job::Job;
use crate::measure::Times;
use crate::outputs::Claims;

const EXAMPLES: &str = "\
Examples:
  liveview render scene --target IMG_7.jpg -o new.png --compare compare.png
  liveview render scene --heldout 8 --layers guided:4 --compare compared/
  liveview render scene --target IMG_7.jpg --layers planes:64 -o new.png --depth disparity.png
  liveview render scene --target IMG_7.jpg -o new.png --explain why.png --dense 64
  liveview render scene --pose camera.json --near 1.5 --far 40 -o new.jpg
  liveview render scene --path circle:120 --layers select:16/64 --width 640 -o flight.mp4
  liveview render scene --path spiral:900 -o frames/
  liveview render scene --path spiral:900 -o frames/ --resume";

/// Options of `liveview render`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct RenderArgs {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    targets: TargetArgs,
    #[command(flatten)]
    layers: LayerArgs,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    explain: ExplainArgs,
}

pub(crate) fn run(args: &RenderArgs) -> Result<Output> {
    let mut outputs = Outputs::new(&args.output, args.targets.have_truth())?;
    let photos = args.scene.open()?;
    print_notes(&photos.scene().notes);
    let mut job = Job::open(photos, &args.layers, &args.model)?;
    let targets = args.targets.resolve(job.photos())?;
    let moving = targets.moving;
    let shots = job.synthesizer.shots(targets)?;
    let mut claims = Claims::new(job.scene());
    claims.protect("--pose", args.targets.pose());
    args.model.protect(&mut claims, job.model.path());
    outputs.claim(&shots, &mut claims)?;
    args.explain.claim(&shots, &mut claims)?;
    claims.prepare()?;
    outputs.begin(&shots, || record::fields(&job, &shots, &args.targets, &args.layers))?;
    job.progress = progress("layers")?;
    let wanted = shots.len();
    let runs = job.synthesizer.renderer().network().run_end().into_iter().collect();
    // A single picture is not worth finishing: there Ctrl-C ends the program at once.
    let stop = if wanted > 1 { interrupt::watch(runs)? } else { Arc::default() };
    let rendered = render(&mut job, shots, moving, &mut outputs, args, &stop);
    job.progress.finish_and_clear();
    // What failed after an interrupt, such as a run of the network that was ended for it, failed for it.
    let rendered = rendered.map_err(|error| if interrupt::requested() { Interrupted.into() } else { error });
    let (done, explanation) = rendered.inspect_err(|_| outputs.print_how_to_resume(wanted))?;
    check_seen(&done, args)?;
    let video = outputs.finish(&done)?;
    Ok(summary::rendered(&job, &done, moving, video, explanation))
}

/// Whether views cover so little of a picture (`unseen`: the share that none does) that there is nothing to be seen.
fn is_blank(unseen: f64) -> bool {
    unseen > 1.0 - 1e-6
}

/// An error if all pictures are blank; those that are among others are told.
fn check_seen(done: &[Rendered], args: &RenderArgs) -> Result<()> {
    let blank: Vec<&str> = done.iter().filter(|one| is_blank(one.unseen)).map(|one| one.shot.name.as_str()).collect();
    match blank.as_slice() {
        [] => {}
        all if all.len() == done.len() => return Err(nothing_seen(args)),
        [first, ..] => {
            let (count, all) = (blank.len(), done.len());
            print_message(
                "warning",
                format!("{count} of {all} pictures are blank, no view sees any of them: {first} first"),
            );
        }
    }
    Ok(())
}

fn nothing_seen(args: &RenderArgs) -> Error {
    let (scene, targets) = (args.scene.folder().display(), &args.targets);
    anyhow!(
        "{scene}, {targets}: no view sees any of it; expected a viewpoint that looks where the views do, or another --near and --far"
    )
}

/// Renders and writes all shots but those that an earlier run has written.
fn render(
    job: &mut Job,
    shots: Vec<Shot>,
    moving: bool,
    outputs: &mut Outputs,
    args: &RenderArgs,
    stop: &AtomicBool,
) -> Result<(Vec<Rendered>, Option<Explanation>)> {
    // The paper's video: the planes that the first frame selects are those of all frames.
    let shared = moving && matches!(job.layers(), LayerSpec::Select { .. });
    let mut done: Vec<Rendered> = Vec::with_capacity(shots.len());
    let (mut kept, mut explanation): (Option<Plan>, _) = (None, None);
    let single = shots.len() == 1;
    let mut shots = VecDeque::from(shots);
    while let Some(shot) = shots.pop_front() {
        let later = &*shots.make_contiguous();
        if let Some(kept) = outputs.kept(&shot) {
            done.push(kept);
            continue;
        }
        if stop.load(Ordering::Relaxed) {
            return Err(Interrupted.into());
        }
        job.progress.set_message(escaped(&shot.name));
        let started = Instant::now();
        if let (true, None, Some(first)) = (shared, &kept, done.first()) {
            job.synthesizer.photos_mut().load_for(&first.shot, later)?;
            kept = Some(job.plan(&first.shot)?);
        }
        job.synthesizer.photos_mut().load_for(&shot, later)?;
        let truth = shot.truth.map(|view| job.scene().load_image(view)).transpose()?;
        let photos = started.elapsed();
        let plan = match kept.take() {
            Some(plan) => Plan::known(plan.layers),
            None => job.plan(&shot)?,
        };
        let mut frame = job.render(&shot, &plan)?;
        // Scored as rendered, before pixels that no view covers are filled.
        let score = truth.as_ref().and_then(|truth| Score::of(&frame.picture, truth));
        if truth.is_some() && score.is_none() {
            print_message("note", format!("{}: too small to be scored", shot.name));
        }
        let times = Times { photos, coarse: plan.search, select: plan.selection, stages: frame.times };
        let about = Explained { shot: &shot, plan: &plan, frame: &frame, times: &times, truth: truth.as_ref() };
        let pixels = frame.transmittance.len() as f64;
        let unseen = frame.transmittance.iter().map(|&left| f64::from(left)).sum::<f64>() / pixels;
        if single && is_blank(unseen) {
            return Err(nothing_seen(args));
        }
        explanation = args.explain.explain(job, &about)?;
        frame.picture = inpaint_unseen(&frame.picture, &frame.transmittance);
        let digests = outputs.write(&shot, &frame, truth.as_ref())?;
        if frame.logits_not_finite > 0 {
            let strays = frame.logits_not_finite;
            let note = format!("{}: {strays} of the network's logits are NaN or infinite", shot.name);
            job.progress.suspend(|| print_message("note", note));
        }
        let one = Rendered {
            layers: plan.layers.len(),
            times: Some(times),
            score,
            unseen,
            hidden: frame.unseen as f64 / pixels,
            disparity_max: disparity_max(&frame),
            files: outputs.files(&shot),
            shot,
        };
        outputs.written(&one, digests)?;
        done.push(one);
        kept = Some(plan).filter(|_| shared);
    }
    Ok((done, explanation))
}
