//! The photos of a rig at its time steps; recent ones stay in memory.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, bail};
use liveview::ImageRgb;
use liveview_synthesizer::Scene;
use rayon::prelude::*;

use super::{Delivered, Feed, Reader};
use crate::interrupt;

/// Memory for recent frames; the last two of each camera are kept in any case.
const KEPT_BYTES: usize = 128 << 20;
/// Age of the newest frame of a camera that runs, from which on it delivers none.
const MAX_AGE: Duration = Duration::from_secs(1);
/// Memory of a frame.
const BYTES_PER_PIXEL: usize = 12;

/// The frames of all cameras, at any time step; of cameras that run, at the last ones that were taken ([`Self::take`]).
#[derive(Debug)]
pub struct Frames {
    scene: Scene,
    /// Between time steps of cameras that run.
    period: Duration,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    cameras: Vec<CameraFrames>,
    /// The last time step of cameras that run, and when it was taken.
    taken: Option<(usize, Instant)>,
}

impl Frames {
    /// Of the cameras of a scene, from their feeds, in the order of its views; of cameras that run, so many time steps a second.
    pub fn new(scene: Scene, feeds: &[Feed], rate: f64) -> Self {
        let pixels: usize = scene.views.iter().map(|view| view.camera.size().pixels()).sum();
        let capacity = (KEPT_BYTES / (BYTES_PER_PIXEL * pixels.max(1))).max(2);
        let camera = |feed: &Feed| CameraFrames { feed: feed.clone(), reader: None, kept: VecDeque::new(), capacity };
        let state = Mutex::new(State { cameras: feeds.iter().map(camera).collect(), taken: None });
        Self { scene, period: Duration::from_secs_f64(1.0 / rate), state }
    }

    /// The last time step of cameras that run; if it is older than a period, their newest frames become the next.
    pub fn take(&self) -> usize {
        let mut state = self.lock();
        let step = match state.taken {
            Some((step, at)) if at.elapsed() < self.period => return step,
            last => last.map_or(0, |(step, _)| step + 1),
        };
        for (index, camera) in state.cameras.iter_mut().enumerate() {
            let Some(source) = camera.feed.source() else { continue };
            let photo = match source.newest(MAX_AGE) {
                Delivered::Photo(photo, _) => {
                    self.scene.fit(index, photo).map(Arc::new).map_err(|error| error.to_string())
                }
                _ => Err(format!("{} delivers no frame", source.url().display())),
            };
            camera.keep(step, photo);
        }
        state.taken = Some((step, Instant::now()));
        step
    }

    /// The photos of these cameras at a time step, in the order of all cameras; `None` for others, and without a photo.
    pub fn by_camera(&self, step: usize, cameras: &[usize]) -> Vec<Option<Arc<ImageRgb>>> {
        let mut photos = vec![None; self.scene.views.len()];
        cameras.iter().zip(self.at(step, cameras)).for_each(|(&camera, photo)| photos[camera] = photo.ok());
        photos
    }

    /// The photos of these cameras at a time step, or why there are none.
    pub fn at(&self, step: usize, cameras: &[usize]) -> Vec<Result<Arc<ImageRgb>, String>> {
        let (scene, mut state) = (&self.scene, self.lock());
        let read = |(index, camera): (usize, &mut CameraFrames)| {
            let position = cameras.iter().position(|&wanted| wanted == index)?;
            Some((position, camera.at(step, |photo| Ok(scene.fit(index, photo)?))))
        };
        let mut read: Vec<_> = state.cameras.par_iter_mut().enumerate().filter_map(read).collect();
        read.sort_by_key(|&(position, _)| position);
        read.into_iter().map(|(_, photo)| photo).collect()
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The frames of a camera.
#[derive(Debug)]
struct CameraFrames {
    feed: Feed,
    /// A reader, and the time step that it reads next.
    reader: Option<(Reader, usize)>,
    /// The last frames with their time steps, or why they could not be read; the newest first.
    kept: VecDeque<(usize, Result<Arc<ImageRgb>, String>)>,
    capacity: usize,
}

impl CameraFrames {
    fn at(&mut self, step: usize, fit: impl FnOnce(ImageRgb) -> Result<ImageRgb>) -> Result<Arc<ImageRgb>, String> {
        if let Some((_, kept)) = self.kept.iter().find(|(kept, _)| *kept == step) {
            return kept.clone();
        }
        let photo = match self.read(step) {
            Ok(Delivered::Photo(photo, _)) => fit(photo).map(Arc::new),
            Ok(Delivered::Missing) => Err(anyhow!("frame {step} is missing")),
            Ok(Delivered::Ended) => Err(anyhow!("no frames from {step} on")),
            Err(error) => {
                self.reader = None;
                Err(error)
            }
        };
        let photo = photo.map_err(|error| format!("{error:#}"));
        // After an error the reader is gone: the next request tries again.
        if self.reader.is_some() {
            self.keep(step, photo.clone());
        }
        photo
    }

    fn keep(&mut self, step: usize, photo: Result<Arc<ImageRgb>, String>) {
        self.kept.truncate(self.capacity - 1);
        self.kept.push_front((step, photo));
    }

    /// Reads a frame. A video is only read forwards: for an earlier step it is opened again.
    fn read(&mut self, step: usize) -> Result<Delivered> {
        // What was taken of it is kept; a reader would keep each step that is asked for as well.
        if self.feed.source().is_some() {
            return Ok(Delivered::Missing);
        }
        let (reader, next) = match self.reader.take().filter(|(_, next)| *next <= step) {
            Some(reader) => self.reader.insert(reader),
            None => self.reader.insert((self.feed.open()?, 0)),
        };
        while *next < step {
            if interrupt::requested() {
                bail!("interrupted");
            }
            if !reader.skip(*next)? {
                return Ok(Delivered::Ended);
            }
            *next += 1;
        }
        *next += 1;
        reader.read(step)
    }
}
