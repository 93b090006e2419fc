//! Sets up the pipeline: cameras → time steps → frames → file. Each stage has its own threads, with bounded channels between them.

use std::sync::atomic::AtomicUsize;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use anyhow::{Result, bail};
use liveview::live::{LiveSession, LiveSettings, Policy};
use liveview::{Camera, ImageRgb, LayerSpec};
use liveview_common::args::layers::given_or_recommended;
use liveview_common::console::{Output, print_message, print_notes, progress};
use liveview_common::interrupt::{self, Interrupted, Shortened};
use liveview_common::outputs::OutputPlan;

use super::gather::{Clock, Faults, Gathering};
use super::options::VideoArgs;
use super::player::{Player, scaled};
use super::scorer::Scorer;
use super::sink::Sink;
use super::summary::summary;
use super::tally::Tally;
use crate::governor::Governor;
use crate::rig::{Rig, SPARE_CAMERAS};

/// Share of the time between two frames, or of the latency, for rendering; reading and writing need the rest.
const RENDER_SHARE: f64 = 0.9;

/// Runs `liveview video`.
pub fn run(args: &VideoArgs) -> Result<Output> {
    let rig = Rig::open(&args.scene)?;
    let fps = args.fps.map_or_else(|| rig.rate(), Ok)?;
    let sink = Sink::new(&args.output, fps)?;
    print_notes(&rig.views.scene().notes);
    let viewpoint = args.viewpoint.resolve(&rig.views)?;
    let given = args.layers.given();
    let (renderer, model) = args.model.open_for(given.as_ref())?;
    let views = renderer.network().views();
    let layers = given_or_recommended(given.as_ref(), renderer.network())?;
    let opacities = renderer.network().predicts_opacity();
    let policy = policy(args.policy, &layers)?;
    let mut renderers = args.model.open_smaller(views, given.as_ref())?;
    let fewest = renderers.iter().map(|renderer| renderer.network().views()).min().unwrap_or(views);
    let free: Vec<usize> = (0..rig.feeds.len()).filter(|&camera| Some(camera) != viewpoint.truth).collect();
    if free.len() < views {
        print_message("note", format_args!("a frame is made from {views} views, but there are only {}", free.len()));
    }
    let read = rig.cameras_for(viewpoint.cameras(), &free, (fewest, views + SPARE_CAMERAS))?;
    let (near, far) = rig.views.depth_range(&read, &[])?;
    let mut settings = LiveSettings::new(near, far);
    (settings.layers, settings.policy, settings.keep_exposure) = (layers.clone(), policy, args.keep_exposure);
    renderers.push(renderer);
    let runs = renderers.iter().filter_map(|renderer| renderer.network().run_end()).collect();
    let cameras = rig.views.scene().views.iter().map(|view| view.camera.clone()).collect();
    let mut session = LiveSession::new(cameras, renderers, settings)?;
    let known = read.iter().map(|&camera| rig.feeds[camera].steps()).collect::<Option<Vec<_>>>();
    let all = known.and_then(|steps| steps.into_iter().max()).unwrap_or(usize::MAX);
    let (first, last) = args.frames.as_ref().map_or((0, all), |range| (range.start, range.end.min(all)));
    if first >= last {
        bail!("--frames {first}..: expected a range within the cameras' {all} time steps, which count from 0");
    }
    let mut output_plan = OutputPlan::new(rig.views.scene());
    output_plan.protect("--poses", args.viewpoint.poses());
    args.model.protect(&mut output_plan, model.path());
    sink.plan_outputs(&mut output_plan)?;
    args.log.iter().try_for_each(|log| output_plan.file("--log", log))?;
    output_plan.prepare()?;
    let stop = interrupt::watch(runs)?;
    let tally = Tally::new(args.log.as_deref(), model.weighting_stage())?;
    let bar = progress("frames")?;
    if last < usize::MAX {
        bar.set_length(last.saturating_sub(first) as u64);
    }
    let mut live = None;
    if let Some(latency) = args.latency {
        let budget = Duration::from_secs_f64(1.0 / fps.per_second()).min(latency).mul_f64(RENDER_SHARE);
        let governor = Governor::new(budget, &layers, opacities);
        let warm = warm_up(&mut session, &read, viewpoint.camera(first), &governor);
        warm.map_err(|error| if interrupt::requested() { Interrupted.into() } else { error })?;
        live = Some((governor, Clock::new((first, last), fps.per_second(), latency)));
    }
    // A live video is not scored: that would take too long.
    let truth = viewpoint.truth.filter(|_| live.is_none());
    let gathering = Arc::new(Gathering {
        scene: rig.views.scene().clone(),
        feeds: rig.feeds.clone(),
        read: read.iter().copied().chain(truth).collect(),
        truth,
        steps: first..last,
        clock: live.as_ref().map(|(_, clock)| *clock),
        stop: Arc::clone(&stop),
        faults: Mutex::new(Faults { cameras: rig.feeds.iter().map(|_| (0, None)).collect() }),
        wanted: AtomicUsize::new(first),
        decoders: Mutex::default(),
    });
    let player = Player {
        session,
        settled: false,
        viewpoint: &viewpoint,
        truth,
        live,
        scorer: Scorer::default(),
        tally,
        changes: Vec::new(),
        bar,
    };
    let (played, file) = player.play(&gathering, sink)?;
    let output = summary(&rig, &viewpoint, &played, file.as_deref(), &model, (&layers, policy));
    if played.interrupted {
        let video = file.map_or_else(|| "the video".to_owned(), |file| file.display().to_string());
        let what = format!("{video} is short, it has {} frames", played.written.frames);
        return Err(Shortened { what, output }.into());
    }
    Ok(output)
}

/// The policy given, checked against the layers, or the default for these.
fn policy(given: Option<Policy>, layers: &LayerSpec) -> Result<Policy> {
    match given {
        Some(Policy::Propagate) if Policy::default_for(layers) != Policy::Propagate => {
            bail!(
                "--policy propagate: only guided and surface layers have depth to propagate; expected each, every:N or once for {layers}"
            )
        }
        Some(policy) => Ok(policy),
        None => Ok(Policy::default_for(layers)),
    }
}

/// Renders a picture of each size that the video may have: the first of a size takes longer than later ones.
fn warm_up(session: &mut LiveSession, read: &[usize], target: &Camera, governor: &Governor) -> Result<()> {
    let grey = |camera: &Camera| {
        let (width, height) = (camera.width(), camera.height());
        ImageRgb::new(width, height, vec![0.5; 3 * width * height])
    };
    let cameras = session.cameras().iter().enumerate();
    let photos = cameras
        .map(|(index, camera)| read.contains(&index).then(|| grey(camera)).transpose())
        .collect::<Result<Vec<_>, _>>()?;
    let photos: Vec<Option<&ImageRgb>> = photos.iter().map(Option::as_ref).collect();
    for scale in governor.scales() {
        session.render(&photos, &scaled(target, scale)?)?;
        session.restart();
    }
    Ok(())
}
