//! The rendering stage of the pipeline, between the threads that read and the one that writes.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Instant;

use anyhow::{Result, anyhow, bail};
use liveview::{Camera, ImageRgb};

use super::Viewpoint;
use super::gather::{Clock, Faults, Gathering, Step};
use super::report::{Scorer, Tally, VideoResults};
use super::sink::{Sink, WriterInput, write};
use crate::governor::{Governor, Level};
use crate::interrupt::{self, Interrupted};
use crate::rig::Feed;
use crate::session::{LiveError, LiveSession};

/// Frames queued between the renderer and the writer.
const QUEUED_FRAMES: usize = 2;

/// What is reported while a video is rendered.
#[derive(Debug)]
pub enum Progress<'a> {
    /// It begins, with so many time steps where their number is known.
    Begin(Option<usize>),
    /// So many time steps are done.
    Done(usize),
    /// A note for the user.
    Note(&'a str),
}

/// Renders time steps and passes the frames to the writer.
pub(super) struct Player<'a> {
    pub(super) session: LiveSession,
    /// Whether a frame of the governor's current level was rendered.
    pub(super) settled: bool,
    pub(super) viewpoint: &'a Viewpoint,
    pub(super) truth: Option<usize>,
    pub(super) live: Option<(Governor, Clock)>,
    pub(super) scorer: Scorer,
    pub(super) tally: Tally,
    pub(super) changes: Vec<(usize, Level)>,
    pub(super) report: &'a mut dyn FnMut(Progress<'_>),
}

impl Player<'_> {
    /// Renders the whole video; its results, and the file or folder written.
    pub(super) fn play(mut self, gathering: &Arc<Gathering>, sink: Sink) -> Result<(VideoResults, Option<PathBuf>)> {
        let started = Instant::now();
        let target = self.viewpoint.camera(0);
        let (size, clock) = (target.size(), gathering.clock);
        let first = gathering.steps.start;
        let stop = Arc::clone(&gathering.stop);
        let (rendered, written) = std::thread::scope(|scope| {
            let steps = gathering.start(scope);
            let (shown, frames) = sync_channel(QUEUED_FRAMES);
            let stop = &stop;
            let writer = scope.spawn(move || write(sink, &frames, size, clock, stop));
            let rendered = self.render_all(first, &steps, &shown);
            drop((steps, shown));
            (rendered, writer.join())
        });
        let stopped = stop.load(Ordering::Relaxed);
        // A failure of the writer goes first: rendering stopped because of it.
        let (written, sink) = written.map_err(|_| anyhow!("the thread that writes the video failed"))??;
        rendered?;
        let faults = std::mem::take(&mut *gathering.lock_faults());
        if !self.tally.covered {
            if stopped {
                return Err(Interrupted.into());
            }
            bail!("{}: {}", gathering.scene.root.display(), self.why_empty(first, &faults, &gathering.feeds));
        }
        let file = sink.finish()?;
        self.tally.finish()?;
        let Self { tally, changes, .. } = self;
        let all = gathering.steps.len();
        let interrupted = stopped && interrupt::requested() && tally.rendered + tally.repeated < all;
        let wall = started.elapsed();
        Ok((VideoResults { tally, written, faults, changes, wall, stopped, interrupted }, file))
    }

    /// The reason why the video from step `first` on shows nothing.
    fn why_empty(&mut self, first: usize, faults: &Faults, feeds: &[Feed]) -> String {
        if self.tally.rendered > 0 {
            return "no camera sees any part of the video; expected a viewpoint that looks where the cameras look"
                .to_owned();
        }
        let reasons = [faults.reasons(feeds), self.tally.why_repeated.take().unwrap_or_default()];
        let reasons: Vec<String> = reasons.into_iter().filter(|reasons| !reasons.is_empty()).collect();
        let ended = || format!("no camera has a frame from time step {first} on");
        format!("no frame could be rendered: {}", if reasons.is_empty() { ended() } else { reasons.join("; ") })
    }

    fn render_all(&mut self, first: usize, steps: &Receiver<Step>, shown: &SyncSender<WriterInput>) -> Result<()> {
        let mut next = first;
        for step in steps {
            let stale = self.live.as_ref().is_some_and(|(_, clock)| clock.is_stale(step.index));
            // The previous frame is repeated in place of those that are dropped.
            let dropped = step.index - next + usize::from(stale);
            for index in next..next + dropped {
                self.tally.dropped += 1;
                self.tally.repeat(index, "dropped: too late")?;
                if shown.send(WriterInput::Repeat).is_err() {
                    return Ok(());
                }
            }
            next = step.index + 1;
            (self.report)(Progress::Done(next - first));
            if !stale && !self.render(step, shown)? {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Renders a step, or repeats the previous frame; false if the writer has stopped or the network was interrupted.
    fn render(&mut self, mut step: Step, shown: &SyncSender<WriterInput>) -> Result<bool> {
        let truth = self.truth.and_then(|truth| step.photos[truth].take());
        let level = self.live.as_ref().map(|(governor, _)| governor.level());
        let target = scaled(self.viewpoint.camera(step.index), level.map_or(1.0, |level| level.scale))?;
        let photos: Vec<Option<&ImageRgb>> = step.photos.iter().map(Option::as_ref).collect();
        let frame = match self.session.render(&photos, &target) {
            Ok(frame) => frame,
            Err(error @ LiveError::Views(_)) => {
                self.scorer.restart();
                self.tally.repeat(step.index, &error.to_string())?;
                return Ok(shown.send(WriterInput::Repeat).is_ok());
            }
            Err(error) if interrupt::requested() => {
                (self.report)(Progress::Note(&format!("frame {} was given up: {error}", step.index)));
                return Ok(false);
            }
            Err(error) => return Err(error.into()),
        };
        let scores = match truth {
            Some(truth) => self.scorer.score(frame.frame.raw(), truth),
            None => {
                self.scorer.restart();
                None
            }
        };
        self.tally.add(step.index, &frame, scores)?;
        // The first frame of a level takes longer: its time does not count.
        let settled = std::mem::replace(&mut self.settled, true);
        let live = self.live.as_mut().filter(|_| settled);
        if let Some(level) = live.and_then(|(governor, _)| governor.record(frame.times.total())) {
            self.session.set_layers(level.layers.clone());
            self.settled = false;
            self.changes.push((step.index + 1, level.clone()));
        }
        Ok(shown.send(WriterInput::Frame { step: step.index, frame: Box::new(frame.frame) }).is_ok())
    }
}

/// The target camera with both sides of the picture scaled.
pub(super) fn scaled(target: &Camera, scale: f64) -> Result<Camera> {
    let side = |side: usize| ((side as f64 * scale).round() as usize).max(1);
    Ok(target.with_size_scaled(side(target.width()), side(target.height()))?)
}
