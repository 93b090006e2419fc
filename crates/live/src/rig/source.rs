//! A camera that runs: ffmpeg opens its source, and is started again when it ends or fails. A thread keeps its newest frames,
//! with the times by which those of several cameras are matched.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use liveview::ImageRgb;

use super::Delivered;
use crate::ffmpeg::{Decoder, has_ended};

/// Frames that are kept: the newest, and of those matched by the streams' time stamps as many as the others may be late.
const KEPT: usize = 2;
const KEPT_BY_STAMP: usize = 16;
/// How long the first frame may take.
const FIRST_FRAME: Duration = Duration::from_secs(15);
/// How long ffmpeg may deliver nothing before it is started again.
const MAX_IDLE: Duration = Duration::from_secs(10);
/// Pauses before it is started again: the first, doubled each time that no frame came, and the longest.
const PAUSES: (Duration, Duration) = (Duration::from_millis(250), Duration::from_secs(5));
/// Age from which on a frame is too old for a time step, in periods.
const MAX_AGE: f64 = 1.25;
/// Distance from the frame before, relative to the median of the last ones, from which on frames are missing between them.
const GAP: f64 = 1.5;
const GAPS: usize = 31;
/// How fast another clock may run behind this machine's, seconds per second.
const DRIFT: f64 = 1e-4;
/// Seconds that a stream's time stamps may differ from another's.
const MAX_LATE: f64 = 60.0;

/// The times by which the frames of sources are matched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SourceClock {
    /// When each frame arrived.
    Arrival,
    /// The time stamps of the streams, which must come from one clock.
    Stream,
    /// None: the first frames belong together, the second, and so on, as in files.
    Frame,
}

impl FromStr for SourceClock {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "arrival" => Ok(Self::Arrival),
            "stream" => Ok(Self::Stream),
            "frame" => Ok(Self::Frame),
            _ => Err("expected arrival, stream or frame"),
        }
    }
}

/// What a source has delivered.
#[derive(Debug, Clone, Default)]
pub struct SourceCounts {
    /// Frames that arrived.
    pub frames: usize,
    /// Of these, frames that no time step used, because a newer one came first.
    pub unused: usize,
    /// Frames missing between those that arrived.
    pub missing: usize,
    /// The longest time between two frames.
    pub longest_gap: Duration,
    /// How much later its frames arrive than those of the camera with the shortest delay, by the streams' time stamps.
    pub late: Option<Duration>,
    /// How often ffmpeg was started again.
    pub restarts: usize,
    /// Why, the last time.
    pub failure: Option<String>,
}

/// A running camera.
#[derive(Debug)]
pub struct Source {
    url: PathBuf,
    started: Instant,
    /// Where the frames are matched by the streams' time stamps.
    origin: Option<Arc<Origin>>,
    state: Mutex<State>,
    arrived: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// The newest last.
    frames: VecDeque<SourceFrame>,
    /// The last frame's time stamp, and the distances of the last ones.
    stamp: Option<f64>,
    gaps: VecDeque<f64>,
    counts: SourceCounts,
}

#[derive(Debug)]
struct SourceFrame {
    photo: ImageRgb,
    arrived: Instant,
    /// The time by which it is matched.
    time: Instant,
    is_used: bool,
}

/// When time 0 of the streams was, by the frame with the shortest delay.
#[derive(Debug)]
pub(super) struct Origin {
    epoch: Instant,
    /// In seconds from the epoch on, and when that was found.
    zero: Mutex<Option<(f64, f64)>>,
}

impl Origin {
    pub(super) fn new() -> Self {
        Self { epoch: Instant::now(), zero: Mutex::default() }
    }

    /// The time of a frame with this time stamp, and its delay; an error if it is not from the clock of the others.
    fn time(&self, arrived: Instant, stamp: f64) -> Result<(Instant, Duration)> {
        let now = (arrived - self.epoch).as_secs_f64();
        let mut zero = self.zero.lock().unwrap_or_else(PoisonError::into_inner);
        let (at, found) = zero.unwrap_or((now - stamp, now));
        let at = (at + DRIFT * (now - found)).min(now - stamp);
        let late = now - stamp - at;
        if late > MAX_LATE {
            bail!(
                "its time stamps are {late:.0} s behind another camera's; expected streams of one clock, or --clock arrival"
            );
        }
        *zero = Some((at, now));
        Ok((self.epoch + Duration::from_secs_f64((at + stamp).max(0.0)), Duration::from_secs_f64(late)))
    }
}

impl Source {
    /// Starts to read a camera: an address, a device, or a file that grows.
    pub(super) fn start(url: &Path, origin: Option<Arc<Origin>>) -> Arc<Self> {
        let (state, arrived) = Default::default();
        let source = Arc::new(Self { url: url.to_owned(), started: Instant::now(), origin, state, arrived });
        let running = Arc::clone(&source);
        std::thread::spawn(move || running.run());
        source
    }

    /// What ffmpeg opens.
    pub fn url(&self) -> &Path {
        &self.url
    }

    /// What it has delivered so far.
    pub fn counts(&self) -> SourceCounts {
        self.lock().counts.clone()
    }

    /// The first frame.
    ///
    /// # Errors
    /// None has come in time.
    pub(super) fn first(&self) -> Result<ImageRgb> {
        let left = (self.started + FIRST_FRAME).saturating_duration_since(Instant::now());
        let waited = self.arrived.wait_timeout_while(self.lock(), left, |state| state.frames.is_empty());
        let (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let Some(frame) = state.frames.back() else {
            let why = state.counts.failure.as_deref().unwrap_or("nothing arrived");
            bail!("{}: no frame within {} s: {why}", self.url.display(), FIRST_FRAME.as_secs());
        };
        Ok(frame.photo.clone())
    }

    /// The newest frame, if it is not older than that.
    pub(super) fn newest(&self, age: Duration) -> Delivered {
        let mut state = self.lock();
        let newest = state.frames.back_mut().filter(|frame| frame.arrived.elapsed() <= age);
        newest.map_or(Delivered::Missing, |frame| {
            frame.is_used = true;
            Delivered::Photo(frame.photo.clone(), frame.arrived)
        })
    }

    /// The newest frame for the time step that is due then; waits for one as long as it may be late.
    pub fn frame_at(&self, due: Instant, period: Duration, late: Duration) -> Delivered {
        let age = period.mul_f64(MAX_AGE);
        let newest = self.origin.as_ref().map(|_| due + period / 2);
        let mut state = self.lock();
        loop {
            let mut frames = state.frames.iter_mut().rev();
            let found = frames.find(|frame| newest.is_none_or(|newest| frame.time <= newest));
            if let Some(frame) = found.filter(|frame| frame.time + age >= due) {
                frame.is_used = true;
                return Delivered::Photo(frame.photo.clone(), frame.arrived);
            }
            // One that was waited for before, in vain, is not waited for again.
            let expected = state.frames.back().map_or(due, |frame| frame.time + age);
            let left = (due.min(expected) + late).saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Delivered::Missing;
            }
            state = self.arrived.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn run(&self) {
        let mut pause = PAUSES.0;
        loop {
            let before = self.lock().counts.frames;
            let failure = self.read().err().map(|error| format!("{error:#}"));
            if has_ended() {
                return;
            }
            let mut state = self.lock();
            state.counts.failure = Some(failure.unwrap_or_else(|| format!("{}: ended", self.url.display())));
            state.counts.restarts += 1;
            pause = if state.counts.frames > before { PAUSES.0 } else { PAUSES.1.min(2 * pause) };
            drop(state);
            std::thread::sleep(pause);
        }
    }

    /// Reads frames until there are no more.
    fn read(&self) -> Result<()> {
        let mut decoder = Decoder::live(&self.url, MAX_IDLE)?;
        while let Some(photo) = decoder.next()? {
            let arrived = Instant::now();
            let stamps = decoder.stamps(self.origin.is_some());
            let (time, late) = match (&self.origin, stamps.first().filter(|stamp| stamp.is_finite())) {
                (Some(origin), Some(&stamp)) => origin.time(arrived, stamp)?,
                (Some(_), None) => bail!("ffmpeg reports no time stamps; expected --clock arrival"),
                (None, _) => (arrived, Duration::ZERO),
            };
            let mut state = self.lock();
            state.counts.late = state.counts.late.map_or(late, |known| known.min(late)).into();
            stamps.into_iter().for_each(|stamp| state.find_missing(stamp));
            state.add(SourceFrame { photo, arrived, time, is_used: false }, self.origin.is_some());
            drop(state);
            self.arrived.notify_all();
        }
        Ok(())
    }
}

impl State {
    /// Counts the frames that are missing before the one with this time stamp.
    fn find_missing(&mut self, stamp: f64) {
        let gap = self.stamp.replace(stamp).map_or(0.0, |before| stamp - before);
        if !(0.0..MAX_LATE).contains(&gap) {
            return;
        }
        let mut gaps: Vec<f64> = self.gaps.iter().copied().collect();
        gaps.sort_by(f64::total_cmp);
        if let Some(median) = gaps.get(GAPS / 2).filter(|&&median| median > 0.0 && gap > GAP * median) {
            self.counts.missing += (gap / median).round() as usize - 1;
        }
        self.gaps.truncate(GAPS - 1);
        self.gaps.push_front(gap);
    }

    fn add(&mut self, frame: SourceFrame, by_stamp: bool) {
        let counts = &mut self.counts;
        counts.frames += 1;
        if let Some(last) = self.frames.back() {
            counts.longest_gap = counts.longest_gap.max(frame.arrived - last.arrived);
        }
        self.frames.push_back(frame);
        if self.frames.len() > if by_stamp { KEPT_BY_STAMP } else { KEPT } {
            let oldest = self.frames.pop_front();
            counts.unused += usize::from(oldest.is_some_and(|oldest| !oldest.is_used));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Duration = Duration::from_millis(50);

    fn source(origin: Option<Arc<Origin>>) -> Arc<Source> {
        let (url, (state, arrived)) = ("test://0".into(), Default::default());
        Arc::new(Source { url, started: Instant::now(), origin, state, arrived })
    }

    /// Adds a frame of a grey level; `time`: by which it is matched.
    fn add(source: &Source, grey: f32, time: Instant) {
        let photo = ImageRgb::new(1, 1, vec![grey; 3]).unwrap();
        let frame = SourceFrame { photo, arrived: time, time, is_used: false };
        source.lock().add(frame, source.origin.is_some());
        source.arrived.notify_all();
    }

    /// The grey level of the frame for a step.
    fn at(source: &Source, due: Instant, late: Duration) -> Option<f32> {
        match source.frame_at(due, PERIOD, late) {
            Delivered::Photo(photo, _) => Some(photo.data()[0]),
            _ => None,
        }
    }

    #[test]
    fn newest_frame_wins_unless_it_is_too_old() {
        let (source, start) = (source(None), Instant::now());
        [0.1, 0.2, 0.3].into_iter().for_each(|grey| add(&source, grey, start));
        assert_eq!(source.counts().unused, 1, "two are kept");
        assert_eq!(at(&source, start, Duration::ZERO), Some(0.3));
        assert_eq!(at(&source, start + PERIOD.mul_f64(1.2), Duration::ZERO), Some(0.3));
        assert_eq!(at(&source, start + PERIOD.mul_f64(1.3), Duration::ZERO), None);
        [0.4, 0.5].into_iter().for_each(|grey| add(&source, grey, start));
        assert_eq!(source.counts().unused, 2, "0.3 was used");
    }

    #[test]
    fn late_frame_is_waited_for_once() {
        let (source, start, late) = (source(None), Instant::now(), Duration::from_secs(2));
        let long_ago = start.checked_sub(Duration::from_secs(5)).unwrap();
        add(&source, 0.1, long_ago);
        assert_eq!(at(&source, start, late), None);
        assert!(start.elapsed() < late, "it stalled before");
        add(&source, 0.2, start);
        let later = Arc::clone(&source);
        let adding = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(100));
            add(&later, 0.3, Instant::now());
        });
        assert_eq!(at(&source, start + 2 * PERIOD, late), Some(0.3));
        adding.join().unwrap();
    }

    #[test]
    fn frames_of_a_shared_clock_are_matched_by_its_time() {
        let origin = Arc::new(Origin::new());
        let (source, epoch) = (source(Some(Arc::clone(&origin))), origin.epoch);
        let second = Duration::from_secs(1);
        // Of another camera without delay, and of this one 0.3 s later.
        let (first, none) = origin.time(epoch + 10 * second, 1000.0).unwrap();
        let (time, late) = origin.time(epoch + 10 * second + Duration::from_millis(300), 1000.0).unwrap();
        assert!(none.is_zero() && late.abs_diff(Duration::from_millis(300)) < Duration::from_millis(1), "{late:?}");
        assert!(time.duration_since(first) < Duration::from_millis(1));
        for (frame, grey) in [0.1, 0.2, 0.3].into_iter().enumerate() {
            add(&source, grey, time + PERIOD * frame as u32);
        }
        assert_eq!(at(&source, time + PERIOD, Duration::ZERO), Some(0.2), "not the newest");
        assert!(origin.time(epoch + 20 * second, 900.0).is_err(), "another clock");
    }

    #[test]
    fn frames_missing_by_their_time_stamps_are_counted() {
        let mut state = State::default();
        (0..100).filter(|frame| frame % 5 != 4).for_each(|frame| state.find_missing(0.05 * f64::from(frame)));
        // From the 17th frame on, whose gaps are compared with those before.
        assert!((14..=16).contains(&state.counts.missing), "{}", state.counts.missing);
        state.find_missing(0.0);
        state.find_missing(f64::NAN);
        state.find_missing(1e9);
        assert!(state.counts.missing <= 16, "a stream that starts again");
    }
}
