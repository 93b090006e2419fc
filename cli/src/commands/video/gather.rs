//! Reads the cameras and collects time steps: one thread per camera reads and decodes its frames, another collects those of each step.
//! All channels are bounded, so that memory does not grow with the length of the video.
//!
//! A live step waits for its cameras for half the latency. On a slow machine, where all cameras are read slowly, none is left out for
//! that: each may take as long as reading all of them one after the other at the fastest camera's rate. Until the first camera has
//! delivered, nothing can be rendered, and the step waits longer.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::{Scope, sleep, spawn};
use std::time::{Duration, Instant};

use anyhow::anyhow;
use liveview::ImageRgb;
use liveview_synthesizer::Scene;

use liveview_live::ffmpeg::end_reading;
use liveview_live::rig::{Delivered, Feed, Reader};

/// Frames that a camera may be read ahead of the others.
const READ_AHEAD: usize = 2;
/// How long all cameras may deliver nothing before a video of running cameras ends.
const MAX_SILENCE: Duration = Duration::from_secs(30);
/// The first wanted step once the video is over.
const NO_STEP: usize = usize::MAX;

/// When the frames of a live rig are due, and how late they may be.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clock {
    start: Instant,
    steps: (usize, usize),
    period: Duration,
    pub(super) latency: Duration,
}

impl Clock {
    /// A clock that starts now, for the steps `steps.0` to `steps.1` - 1.
    pub(super) fn new(steps: (usize, usize), fps: f64, latency: Duration) -> Self {
        Self { start: Instant::now(), steps, period: Duration::from_secs_f64(1.0 / fps), latency }
    }

    pub(super) fn due(&self, step: usize) -> Instant {
        self.start + self.period.mul_f64((step - self.steps.0) as f64)
    }

    /// Whether a step is later than the latency allows while a newer one is due.
    pub(super) fn is_stale(&self, step: usize) -> bool {
        let now = Instant::now();
        step + 1 < self.steps.1 && now > self.due(step) + self.latency && now >= self.due(step + 1)
    }
}

/// The photos of one time step.
pub(super) struct Step {
    pub(super) index: usize,
    /// By camera; `None` for a camera that has delivered none, or that is not read.
    pub(super) photos: Vec<Option<Photo>>,
    /// How long it waited for them.
    pub(super) waited: Duration,
}

/// A photo, and when it arrived; if it is read from a file for a live video, when it was due.
pub(super) type Photo = (ImageRgb, Instant);

/// Frames that cameras did not deliver.
#[derive(Debug, Default)]
pub(super) struct Faults {
    /// By camera: the number of missing, damaged and late frames, and the message about the first.
    pub(super) cameras: Vec<(usize, Option<String>)>,
}

impl Faults {
    /// The message about the first of each camera that has any.
    pub(super) fn reasons(&self, feeds: &[Feed]) -> String {
        let faults = feeds.iter().zip(&self.cameras);
        let reasons = faults.filter_map(|(feed, (_, first))| Some(format!("{}: {}", feed.name, first.as_ref()?)));
        reasons.collect::<Vec<_>>().join("; ")
    }
}

/// The state that the threads share.
pub(super) struct Gathering {
    pub(super) scene: Scene,
    pub(super) feeds: Vec<Feed>,
    /// Cameras to read.
    pub(super) read: Vec<usize>,
    /// The camera that is the ground truth; the video ends when the others have ended.
    pub(super) truth: Option<usize>,
    pub(super) steps: std::ops::Range<usize>,
    pub(super) clock: Option<Clock>,
    /// Set to end the video early.
    pub(super) stop: Arc<AtomicBool>,
    pub(super) faults: Mutex<Faults>,
    /// The first wanted step: readers skip earlier ones.
    pub(super) wanted: AtomicUsize,
}

impl Gathering {
    /// Starts the threads. The receiver gets the time steps in order, without those that the clock finds too late.
    pub(super) fn start<'scope>(self: &Arc<Self>, scope: &'scope Scope<'scope, '_>) -> Receiver<Step> {
        // Of a live rig no second step waits behind the one that the renderer takes next.
        let (sender, steps) = sync_channel(if self.clock.is_some() { 0 } else { 1 });
        let this = Arc::clone(self);
        scope.spawn(move || {
            let mut cameras = Vec::new();
            for &camera in &this.read {
                let (sender, frames) = sync_channel(READ_AHEAD);
                let reader = Arc::clone(&this);
                // Outside of the scope, which would wait for it: reading from a stalled camera may never end.
                spawn(move || reader.read_camera(camera, &sender));
                cameras.push(Camera::new(camera, frames));
            }
            this.gather(&mut cameras, &sender);
            this.wanted.store(NO_STEP, Ordering::Relaxed);
            end_reading();
        });
        steps
    }

    fn read_camera(&self, camera: usize, frames: &SyncSender<Frame>) {
        let mut reader = match self.feeds[camera].open() {
            Ok(reader) => reader,
            Err(error) => return self.reason(camera, &format!("{error:#}")),
        };
        for step in 0..self.steps.start {
            match reader.skip(step) {
                Ok(true) if !self.is_over() => {}
                Err(error) if !self.is_over() => return self.reason(camera, &format!("{error:#}")),
                _ => return,
            }
        }
        for step in self.steps.clone() {
            if let Some(clock) = self.clock {
                sleep(clock.due(step).saturating_duration_since(Instant::now()));
            }
            if self.is_over() {
                return;
            }
            if step < self.wanted.load(Ordering::Relaxed) {
                match reader.skip(step) {
                    Ok(true) => continue,
                    Err(error) if !self.is_over() => return self.reason(camera, &format!("{error:#}")),
                    _ => return,
                }
            }
            let started = Instant::now();
            let photo = match self.read(&mut reader, camera, step) {
                Ok(Delivered::Photo(photo, arrived)) => Some((photo, arrived)),
                Ok(Delivered::Ended) => return,
                Ok(Delivered::Missing) => {
                    let what = if self.feeds[camera].source().is_some() { "was late" } else { "is missing" };
                    self.fault(camera, &format!("frame {step} {what}"));
                    None
                }
                Err(_) if self.is_over() => return,
                // A video cannot be read beyond an error.
                Err(error) if self.feeds[camera].is_video() => return self.reason(camera, &format!("{error:#}")),
                Err(error) => {
                    self.fault(camera, &format!("{error:#}"));
                    None
                }
            };
            if frames.send(Frame { step, photo, took: started.elapsed() }).is_err() {
                return;
            }
        }
    }

    fn read(&self, reader: &mut Reader, camera: usize, step: usize) -> anyhow::Result<Delivered> {
        let source = self.feeds[camera].source();
        let delivered = match (source, self.clock) {
            (Some(source), Some(clock)) => source.frame_at(clock.due(step), clock.period, clock.latency / 2),
            _ => reader.read(step)?,
        };
        let Delivered::Photo(photo, arrived) = delivered else { return Ok(delivered) };
        let arrived = self.clock.filter(|_| source.is_none()).map_or(arrived, |clock| clock.due(step));
        let size = (photo.width(), photo.height());
        let photo = self.scene.fit(camera, photo);
        let wrong = |_| anyhow!("frame {step} is {}x{}, not the size of the others", size.0, size.1);
        Ok(Delivered::Photo(photo.map_err(wrong)?, arrived))
    }

    fn gather(&self, cameras: &mut [Camera], steps: &SyncSender<Step>) {
        let mut delivered = Instant::now();
        for index in self.steps.clone() {
            if self.clock.is_some_and(|clock| clock.is_stale(index)) {
                continue;
            }
            self.wanted.store(index, Ordering::Relaxed);
            if let Some(clock) = self.clock {
                sleep(clock.due(index).saturating_duration_since(Instant::now()));
            }
            let mut photos: Vec<Option<Photo>> = self.feeds.iter().map(|_| None).collect();
            let started = Instant::now();
            let late = await_photos(cameras, index, self.clock.map(|clock| clock.latency), &self.stop, &mut photos);
            late.iter().for_each(|&camera| self.fault(camera, &format!("frame {index} was late")));
            let mut sources = cameras.iter().filter(|camera| Some(camera.index) != self.truth);
            // A stalled camera does not keep the video going once all others have ended.
            let any_ended = cameras.iter().any(|camera| camera.ended && Some(camera.index) != self.truth);
            let gone = |camera: &Camera| camera.ended || late.contains(&camera.index);
            let over = any_ended && sources.all(|camera| gone(camera) && photos[camera.index].is_none());
            if photos.iter().any(Option::is_some) {
                delivered = Instant::now();
            }
            let silent = self.feeds.iter().any(|feed| feed.source().is_some()) && delivered.elapsed() > MAX_SILENCE;
            if over || silent || self.stop.load(Ordering::Relaxed) {
                return;
            }
            for camera in cameras.iter().filter(|camera| camera.ended && photos[camera.index].is_none()) {
                self.fault(camera.index, &format!("no frames from {index} on"));
            }
            if steps.send(Step { index, photos, waited: started.elapsed() }).is_err() {
                return;
            }
        }
    }

    fn is_over(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.wanted.load(Ordering::Relaxed) == NO_STEP
    }

    /// Counts a frame that a camera did not deliver.
    fn fault(&self, camera: usize, what: &str) {
        self.lock_faults().cameras[camera].0 += 1;
        self.reason(camera, what);
    }

    /// Records why a camera fails, if it is its first failure. The frames that it does not deliver are counted later.
    fn reason(&self, camera: usize, what: &str) {
        self.lock_faults().cameras[camera].1.get_or_insert_with(|| what.to_owned());
    }

    pub(super) fn lock_faults(&self) -> MutexGuard<'_, Faults> {
        self.faults.lock().expect("no thread panics while it holds the lock")
    }
}

/// Share of the latency that a step waits for a camera.
const WAIT_SHARE: f64 = 0.5;
/// Time that a step waits for its first camera.
const FIRST_CAMERA_TIMEOUT: Duration = Duration::from_secs(1);
/// Interval at which a step checks for photos.
const POLL_INTERVAL: Duration = Duration::from_millis(1);

/// A frame from a camera's thread.
pub(super) struct Frame {
    pub(super) step: usize,
    pub(super) photo: Option<Photo>,
    /// Time to read it.
    pub(super) took: Duration,
}

/// Time that a step waits for cameras that have not delivered; `fastest`: the shortest read time of those that have.
fn wait_limit(latency: Duration, cameras: usize, fastest: Option<Duration>) -> Duration {
    latency.mul_f64(WAIT_SHARE).max(fastest.map_or(FIRST_CAMERA_TIMEOUT, |fastest| fastest * cameras as u32))
}

/// Collects the photos of a time step in `photos`, by camera; returns the cameras that are left out. Without a latency it waits for all
/// cameras.
pub(super) fn await_photos(
    cameras: &mut [Camera],
    step: usize,
    latency: Option<Duration>,
    stop: &AtomicBool,
    photos: &mut [Option<Photo>],
) -> Vec<usize> {
    let (started, count) = (Instant::now(), cameras.len());
    let mut fastest: Option<Duration> = None;
    let mut missing: Vec<&mut Camera> = cameras.iter_mut().collect();
    loop {
        missing.retain_mut(|camera| match camera.frame(step) {
            Ok((photo, took)) => {
                if photo.is_some() {
                    fastest = Some(fastest.map_or(took, |fastest| fastest.min(took)));
                }
                photos[camera.index] = photo;
                false
            }
            Err(TryRecvError::Disconnected) => {
                camera.ended = true;
                false
            }
            Err(TryRecvError::Empty) => true,
        });
        let over = latency.is_some_and(|latency| started.elapsed() > wait_limit(latency, count, fastest));
        if stop.load(Ordering::Relaxed) {
            return Vec::new();
        }
        if missing.is_empty() || over {
            return missing.iter().map(|camera| camera.index).collect();
        }
        sleep(POLL_INTERVAL);
    }
}

/// A camera, for the thread that collects the photos.
pub(super) struct Camera {
    pub(super) index: usize,
    frames: Receiver<Frame>,
    /// A frame of a later step, already received.
    early: Option<Frame>,
    pub(super) ended: bool,
}

impl Camera {
    pub(super) fn new(index: usize, frames: Receiver<Frame>) -> Self {
        Self { index, frames, early: None, ended: false }
    }

    /// Its photo of a time step, if there is one, and the time to read it. Later frames are kept, earlier ones dropped.
    fn frame(&mut self, step: usize) -> Result<(Option<Photo>, Duration), TryRecvError> {
        loop {
            let frame = match self.early.take() {
                Some(early) => early,
                None => self.frames.try_recv()?,
            };
            match frame.step.cmp(&step) {
                std::cmp::Ordering::Less => {}
                std::cmp::Ordering::Equal => return Ok((frame.photo, frame.took)),
                std::cmp::Ordering::Greater => {
                    self.early = Some(frame);
                    return Ok((None, Duration::ZERO));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{SyncSender, sync_channel};

    use super::*;

    const LATENCY: Duration = Duration::from_millis(100);

    fn cameras(count: usize) -> (Vec<SyncSender<Frame>>, Vec<Camera>) {
        let channel = |index| {
            let (sender, frames) = sync_channel(3);
            (sender, Camera::new(index, frames))
        };
        (0..count).map(channel).unzip()
    }

    fn frame(step: usize, took: u64) -> Frame {
        Frame {
            step,
            photo: Some((ImageRgb::new(1, 1, vec![0.5; 3]).unwrap(), Instant::now())),
            took: Duration::from_millis(took),
        }
    }

    /// Whether each camera has delivered step 5, and which are left out.
    fn step(cameras: &mut [Camera]) -> (Vec<bool>, Vec<usize>) {
        let mut photos = vec![None; cameras.len()];
        let late = await_photos(cameras, 5, Some(LATENCY), &AtomicBool::new(false), &mut photos);
        (photos.iter().map(Option::is_some).collect(), late)
    }

    #[test]
    fn stalled_camera_is_left_out_until_it_delivers_again() {
        let (senders, mut cameras) = cameras(3);
        senders[0].send(frame(5, 1)).unwrap();
        senders[1].send(frame(4, 1)).unwrap();
        senders[2].send(frame(5, 1)).unwrap();
        let started = Instant::now();
        assert_eq!(step(&mut cameras), (vec![true, false, true], vec![1]));
        assert!(started.elapsed() >= LATENCY.mul_f64(WAIT_SHARE));
        senders.iter().for_each(|sender| sender.send(frame(5, 1)).unwrap());
        assert_eq!(step(&mut cameras), (vec![true; 3], vec![]));
    }

    #[test]
    fn equally_slow_cameras_are_waited_for() {
        let (senders, mut cameras) = cameras(3);
        // The first delivers after more than the latency, the others as slowly.
        let sending = std::thread::spawn(move || {
            senders.iter().for_each(|sender| {
                sleep(Duration::from_millis(150));
                sender.send(frame(5, 500)).unwrap();
            });
            senders
        });
        assert_eq!(step(&mut cameras), (vec![true; 3], vec![]));
        drop(sending.join().unwrap());
        assert_eq!(step(&mut cameras), (vec![false; 3], vec![]), "ended, not late");
        assert!(cameras.iter().all(|camera| camera.ended));
    }

    #[test]
    fn wait_limit_covers_all_cameras_at_the_fastest_rate() {
        let ms = Duration::from_millis;
        assert_eq!(wait_limit(LATENCY, 6, Some(ms(5))), ms(50));
        assert_eq!(wait_limit(LATENCY, 6, Some(ms(60))), ms(360));
        assert_eq!((wait_limit(LATENCY, 6, None), wait_limit(ms(4000), 6, None)), (FIRST_CAMERA_TIMEOUT, ms(2000)));
    }
}
