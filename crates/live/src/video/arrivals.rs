//! Collects the cameras' photos of a time step, and decides which cameras are left out of it.
//!
//! With a clock a step waits for its cameras for half the latency. On a slow machine all cameras are read slowly, and none is left
//! out for that: each may take as long as reading all of them one after the other at the speed of the fastest. Until the first has
//! delivered, nothing can be rendered, and the step waits longer.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError};
use std::thread::sleep;
use std::time::{Duration, Instant};

use liveview::ImageRgb;

/// Share of the latency that a step waits for a camera.
const LAG: f64 = 0.5;
/// How long a step waits for its first camera.
const FIRST: Duration = Duration::from_secs(1);
/// Interval at which a step checks for photos.
const POLL: Duration = Duration::from_millis(1);

/// A frame from a camera's thread.
pub(super) struct Frame {
    pub(super) step: usize,
    pub(super) photo: Option<ImageRgb>,
    /// Time that reading it took.
    pub(super) took: Duration,
}

/// How long a step waits for the cameras that have not delivered.
fn patience(latency: Duration, cameras: usize, quickest: Option<Duration>) -> Duration {
    latency.mul_f64(LAG).max(quickest.map_or(FIRST, |quickest| quickest * cameras as u32))
}

/// Collects the cameras' photos of a time step, by camera in `photos`; returns the cameras that are left out. Without a latency it
/// waits for all of them.
pub(super) fn await_photos(
    cameras: &mut [Camera],
    step: usize,
    latency: Option<Duration>,
    stop: &AtomicBool,
    photos: &mut [Option<ImageRgb>],
) -> Vec<usize> {
    let (asked, count) = (Instant::now(), cameras.len());
    let mut quickest: Option<Duration> = None;
    let mut missing: Vec<&mut Camera> = cameras.iter_mut().collect();
    loop {
        missing.retain_mut(|camera| match camera.frame(step) {
            Ok((photo, took)) => {
                if photo.is_some() {
                    quickest = Some(quickest.map_or(took, |quickest| quickest.min(took)));
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
        let over = latency.is_some_and(|latency| asked.elapsed() > patience(latency, count, quickest));
        if stop.load(Ordering::Relaxed) {
            return Vec::new();
        }
        if missing.is_empty() || over {
            return missing.iter().map(|camera| camera.index).collect();
        }
        sleep(POLL);
    }
}

/// A camera, as the thread that collects the photos knows it.
pub(super) struct Camera {
    pub(super) index: usize,
    frames: Receiver<Frame>,
    /// A frame of a later step.
    early: Option<Frame>,
    pub(super) ended: bool,
}

impl Camera {
    pub(super) fn new(index: usize, frames: Receiver<Frame>) -> Self {
        Self { index, frames, early: None, ended: false }
    }

    /// Its photo of a time step, if there is one, and the time that reading it took. Later frames are kept, earlier ones dropped.
    fn frame(&mut self, step: usize) -> Result<(Option<ImageRgb>, Duration), TryRecvError> {
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
        Frame { step, photo: ImageRgb::new(1, 1, vec![0.5; 3]).ok(), took: Duration::from_millis(took) }
    }

    /// Which cameras have delivered step 5, and which are left out.
    fn step(cameras: &mut [Camera]) -> (Vec<bool>, Vec<usize>) {
        let mut photos = vec![None; cameras.len()];
        let late = await_photos(cameras, 5, Some(LATENCY), &AtomicBool::new(false), &mut photos);
        (photos.iter().map(Option::is_some).collect(), late)
    }

    #[test]
    fn a_camera_that_stalls_is_left_out_and_comes_back() {
        let (senders, mut cameras) = cameras(3);
        senders[0].send(frame(5, 1)).unwrap();
        senders[1].send(frame(4, 1)).unwrap();
        senders[2].send(frame(5, 1)).unwrap();
        let started = Instant::now();
        assert_eq!(step(&mut cameras), (vec![true, false, true], vec![1]));
        assert!(started.elapsed() >= LATENCY.mul_f64(LAG));
        senders.iter().for_each(|sender| sender.send(frame(5, 1)).unwrap());
        assert_eq!(step(&mut cameras), (vec![true; 3], vec![]));
    }

    #[test]
    fn a_slow_machine_is_waited_for() {
        let (senders, mut cameras) = cameras(3);
        // The first after more than the whole latency, the others as slowly again.
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
    fn one_may_take_as_long_as_all_at_the_pace_of_the_quickest() {
        let ms = Duration::from_millis;
        assert_eq!(patience(LATENCY, 6, Some(ms(5))), ms(50));
        assert_eq!(patience(LATENCY, 6, Some(ms(60))), ms(360));
        assert_eq!((patience(LATENCY, 6, None), patience(ms(4000), 6, None)), (FIRST, ms(2000)));
    }
}
