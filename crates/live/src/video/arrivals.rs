//! Collects the cameras' photos of a time step, and decides which cameras are left out.
//!
//! A live step waits for its cameras for half the latency. On a slow machine, where all cameras are read slowly, none is left out for
//! that: each may take as long as reading all of them one after the other at the fastest camera's rate. Until the first camera has
//! delivered, nothing can be rendered, and the step waits longer.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError};
use std::thread::sleep;
use std::time::{Duration, Instant};

use liveview::ImageRgb;

/// Share of the latency that a step waits for a camera.
const WAIT_SHARE: f64 = 0.5;
/// Time that a step waits for its first camera.
const FIRST_CAMERA_TIMEOUT: Duration = Duration::from_secs(1);
/// Interval at which a step checks for photos.
const POLL_INTERVAL: Duration = Duration::from_millis(1);

/// A frame from a camera's thread.
pub(super) struct Frame {
    pub(super) step: usize,
    pub(super) photo: Option<ImageRgb>,
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
    photos: &mut [Option<ImageRgb>],
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
