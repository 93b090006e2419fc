//! The pipeline: cameras → time steps → frames → file, each stage in threads of its own, bounded channels between them.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, bail};
use indicatif::ProgressBar;
use liveview::geometry::choose_views;
use liveview::live::{LayerSource, LiveError, LiveSession, LiveSettings, Policy};
use liveview::network::OrtNetwork;
use liveview::{Camera, ImageRgb, LayerSpec};

use super::gather::{Clock, Faults, Gathering, Step};
use super::governor::{Governor, Rung};
use super::options::VideoArgs;
use super::played::Played;
use super::rig::Rig;
use super::scorer::Scorer;
use super::sink::Sink;
use super::summary::summary;
use super::tally::Tally;
use super::viewpoint::Viewpoint;
use super::writer::{Shown, write};
use crate::args::layers::recommended;
use crate::console::{Output, progress, tell_notes};
use crate::interrupt;

/// Cameras read beyond those that a frame needs, for when one drops out.
const SPARE: usize = 2;
/// Frames between the renderer and the writer.
const AHEAD: usize = 2;
/// Part of the time between two frames, or of the latency, that rendering may take: reading and writing need the rest.
const SHARE: f64 = 0.9;

pub(crate) fn run(args: &VideoArgs) -> Result<Output> {
    let mut sink = Sink::new(&args.output, args.fps)?;
    let rig = Rig::open(&args.scene)?;
    tell_notes(&rig.photos.scene().notes);
    let seen = args.viewpoint.resolve(&rig.photos)?;
    let (renderer, model) = args.model.open()?;
    let views = renderer.network().card().views;
    let layers = match (&args.layers, args.quality) {
        (Some(layers), _) => layers.clone(),
        (None, Some(quality)) => quality.into(),
        (None, None) => recommended(renderer.network())?,
    };
    let policy = policy(args.policy, &layers)?;
    let mut renderers = args.model.open_smaller(views)?;
    let fewest = renderers.iter().map(|renderer| renderer.network().card().views).min().unwrap_or(views);
    let read = cameras_to_read(&rig, &seen, fewest, views)?;
    let (near, far) = rig.photos.depth_range(&read)?;
    let mut settings = LiveSettings::new(near, far);
    (settings.layers, settings.policy) = (layers.clone(), policy);
    renderers.push(renderer);
    let cameras = rig.photos.scene().views.iter().map(|view| view.camera.clone()).collect();
    let mut session = LiveSession::new(cameras, renderers, settings)?;
    let target = seen.camera(0);
    sink.claim(&rig.photos.scene().root, target.size())?;
    let tally = Tally::new(args.log.as_deref())?;

    let stop = interrupt::watch()?;
    let first = args.frames.as_ref().map_or(0, |range| range.start);
    let known = read.iter().map(|&camera| rig.feeds[camera].steps()).collect::<Option<Vec<_>>>();
    let last = known.and_then(|steps| steps.into_iter().max()).unwrap_or(usize::MAX);
    let last = args.frames.as_ref().map_or(last, |range| range.end.min(last));
    let bar = progress("frames")?;
    if last < usize::MAX {
        bar.set_length(last.saturating_sub(first) as u64);
    }
    let guided = if let LayerSpec::Guided { layers, .. } = layers { Some(layers) } else { None };
    let mut live = None;
    if let Some(latency) = args.latency {
        let budget = Duration::from_secs_f64(1.0 / args.fps as f64).min(latency).mul_f64(SHARE);
        let governor = Governor::new(budget, guided);
        warm_up(&mut session, &read, seen.camera(first), &governor)?;
        live = Some((governor, Clock::new((first, last), args.fps as f64, latency)));
    }
    // A live video has no time for scores.
    let truth = seen.truth.filter(|_| live.is_none());
    let gathering = Gathering {
        scene: rig.photos.scene(),
        feeds: &rig.feeds,
        read: read.iter().copied().chain(truth).collect(),
        truth,
        steps: first..last,
        clock: live.as_ref().map(|(_, clock)| *clock),
        stop: Arc::clone(&stop),
        faults: Mutex::new(Faults { cameras: rig.feeds.iter().map(|_| (0, None)).collect() }),
        wanted: AtomicUsize::new(first),
        decoders: Mutex::default(),
    };
    let player = Player {
        layers: layers.clone(),
        session,
        seen: &seen,
        truth,
        live,
        scorer: Scorer::default(),
        tally,
        changes: Vec::new(),
        bar,
    };
    let (played, file) = player.play(gathering, sink)?;
    Ok(summary(&rig, &seen, &played, file.as_deref(), &model, (&layers, policy)))
}

/// The nearest cameras of each viewpoint, some more than are needed; never the one held out.
fn cameras_to_read(rig: &Rig, seen: &Viewpoint, fewest: usize, views: usize) -> Result<Vec<usize>> {
    let free: Vec<usize> = (0..rig.feeds.len()).filter(|&camera| Some(camera) != seen.truth).collect();
    let cameras: Vec<&Camera> = rig.photos.cameras(&free).collect();
    let mut read = BTreeSet::new();
    for target in seen.cameras() {
        let some = (fewest..=views + SPARE).rev().find_map(|count| choose_views(&cameras, target, count).ok());
        let some = some.map_or_else(|| choose_views(&cameras, target, fewest), Ok);
        read.extend(some.map_err(|error| anyhow!("{}: {error}", rig.photos.scene().root.display()))?);
    }
    Ok(read.into_iter().map(|camera| free[camera]).collect())
}

/// As given, if it suits the layers, else what suits them best.
fn policy(given: Option<Policy>, layers: &LayerSpec) -> Result<Policy> {
    match given {
        Some(Policy::Propagate) if !matches!(layers, LayerSpec::Guided { .. }) => {
            bail!(
                "--policy propagate: guided layers alone have a surface that can be; expected each, every:N or once for {layers}"
            )
        }
        Some(policy) => Ok(policy),
        None => Ok(Policy::default_for(layers)),
    }
}

/// The first picture of a size takes longer than all others.
fn warm_up(session: &mut LiveSession<OrtNetwork>, read: &[usize], target: &Camera, governor: &Governor) -> Result<()> {
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

fn scaled(target: &Camera, scale: f64) -> Result<Camera> {
    let side = |side: usize| ((side as f64 * scale).round() as usize).max(1);
    Ok(target.with_size_scaled(side(target.width()), side(target.height()))?)
}

struct Player<'a> {
    layers: LayerSpec,
    session: LiveSession<OrtNetwork>,
    seen: &'a Viewpoint,
    truth: Option<usize>,
    live: Option<(Governor, Clock)>,
    scorer: Scorer,
    tally: Tally,
    changes: Vec<(usize, Rung)>,
    bar: ProgressBar,
}

impl Player<'_> {
    fn play(mut self, gathering: Gathering<'_>, sink: Sink) -> Result<(Played, Option<PathBuf>)> {
        let started = Instant::now();
        let target = self.seen.camera(0);
        let (size, clock) = (target.size(), gathering.clock);
        let first = gathering.steps.start;
        let stop = Arc::clone(&gathering.stop);
        let (rendered, written) = std::thread::scope(|scope| {
            let steps = gathering.start(scope);
            let (shown, frames) = sync_channel(AHEAD);
            let stop = &stop;
            let writer = scope.spawn(move || write(sink, &frames, size, clock, stop));
            let rendered = self.render_all(first, &steps, &shown);
            drop((steps, shown));
            (rendered, writer.join())
        });
        self.bar.finish_and_clear();
        let stopped = stop.load(Ordering::Relaxed);
        // Where writing failed, rendering stopped because of that.
        let (written, sink) = written.map_err(|_| anyhow!("the thread that writes the video failed"))??;
        rendered?;
        let file = if written.frames > 0 { sink.finish()? } else { None };
        self.tally.finish()?;
        let faults = gathering.faults.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        let Self { tally, changes, .. } = self;
        Ok((Played { tally, written, faults, changes, wall: started.elapsed(), stopped }, file))
    }

    fn render_all(&mut self, first: usize, steps: &Receiver<Step>, shown: &SyncSender<Shown>) -> Result<()> {
        let mut next = first;
        for step in steps {
            let stale = self.live.as_ref().is_some_and(|(_, clock)| clock.is_stale(step.index));
            // Its place in the video is taken by the frame before.
            let dropped = step.index - next + usize::from(stale);
            for index in next..next + dropped {
                self.tally.dropped += 1;
                self.tally.repeat(index, "dropped: too late")?;
                if shown.send(Shown::Repeat).is_err() {
                    return Ok(());
                }
            }
            next = step.index + 1;
            self.bar.set_position((next - first) as u64);
            if !stale && !self.render(step, shown)? {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Renders a step, or repeats the frame before; false where nobody takes it.
    fn render(&mut self, mut step: Step, shown: &SyncSender<Shown>) -> Result<bool> {
        let truth = self.truth.and_then(|truth| step.photos[truth].take());
        let rung = self.live.as_ref().map(|(governor, _)| governor.rung());
        let target = scaled(self.seen.camera(step.index), rung.map_or(1.0, |rung| rung.scale))?;
        let photos: Vec<Option<&ImageRgb>> = step.photos.iter().map(Option::as_ref).collect();
        let frame = match self.session.render(&photos, &target) {
            Ok(frame) => frame,
            Err(error @ LiveError::Views(_)) => {
                self.scorer.interrupt();
                self.tally.repeat(step.index, &error.to_string())?;
                return Ok(shown.send(Shown::Repeat).is_ok());
            }
            Err(error) => return Err(error.into()),
        };
        let scores = match truth {
            Some(truth) => self.scorer.score(&frame.frame.picture, truth),
            None => {
                self.scorer.interrupt();
                None
            }
        };
        self.tally.add(step.index, &frame, scores)?;
        // The paper's first frame has more planes than all others: no measure of them.
        let usual = self.tally.rendered > 1 || frame.layer_source != LayerSource::Dense;
        let live = self.live.as_mut().filter(|_| usual);
        if let Some(rung) = live.and_then(|(governor, _)| governor.note(frame.times.total())) {
            if let (LayerSpec::Guided { layers, .. }, Some(fewer)) = (&mut self.layers, rung.layers) {
                *layers = fewer;
            }
            self.session.set_layers(self.layers.clone());
            self.changes.push((step.index + 1, rung));
        }
        Ok(shown.send(Shown::Frame { step: step.index, frame: Box::new(frame.frame) }).is_ok())
    }
}
