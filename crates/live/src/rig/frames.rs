//! The photos of a rig at its time steps; recent ones stay in memory.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Result, anyhow, bail};
use liveview::ImageRgb;
use liveview_synthesizer::Scene;
use rayon::prelude::*;

use super::{Delivered, Feed, Reader};
use crate::interrupt;

/// Memory for recent frames; the last one of each camera is kept in any case.
const KEPT_BYTES: usize = 128 << 20;
/// Age of the newest frame of a camera that runs, from which on it delivers none.
const MAX_AGE: Duration = Duration::from_secs(1);
/// Memory of a frame.
const BYTES_PER_PIXEL: usize = 12;

/// The frames of all cameras, at any time step. Of cameras that run a step has the newest frames when it is first asked for.
#[derive(Debug)]
pub struct Frames {
    scene: Scene,
    cameras: Vec<CameraFrames>,
}

impl Frames {
    /// Of the cameras of a scene, from their feeds, in the order of its views.
    pub fn new(scene: Scene, feeds: &[Feed]) -> Self {
        let pixels: usize = scene.views.iter().map(|view| view.camera.size().pixels()).sum();
        let capacity = (KEPT_BYTES / (BYTES_PER_PIXEL * pixels.max(1))).max(2);
        let camera = |feed: &Feed| CameraFrames { feed: feed.clone(), reader: None, kept: VecDeque::new(), capacity };
        Self { scene, cameras: feeds.iter().map(camera).collect() }
    }

    /// The photos of these cameras at a time step, in the order of all cameras; `None` for others, and without a photo.
    pub fn by_camera(&mut self, step: usize, cameras: &[usize]) -> Vec<Option<Arc<ImageRgb>>> {
        let mut photos = vec![None; self.cameras.len()];
        cameras.iter().zip(self.at(step, cameras)).for_each(|(&camera, photo)| photos[camera] = photo.ok());
        photos
    }

    /// The photos of these cameras at a time step, or why there are none.
    pub fn at(&mut self, step: usize, cameras: &[usize]) -> Vec<Result<Arc<ImageRgb>, String>> {
        let Self { scene, cameras: all } = self;
        let run = all.iter().any(|camera| camera.feed.source().is_some());
        let read = |(index, camera): (usize, &mut CameraFrames)| {
            let position = cameras.iter().position(|&wanted| wanted == index);
            // Those of cameras that run at once: they belong together.
            let photo = (run || position.is_some()).then(|| camera.at(step, |photo| Ok(scene.fit(index, photo)?)));
            position.zip(photo)
        };
        let mut read: Vec<_> = all.par_iter_mut().enumerate().filter_map(read).collect();
        read.sort_by_key(|&(position, _)| position);
        read.into_iter().map(|(_, photo)| photo).collect()
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
        if self.reader.is_some() || self.feed.source().is_some() {
            self.kept.truncate(self.capacity - 1);
            self.kept.push_front((step, photo.clone()));
        }
        photo
    }

    /// Reads a frame. A video is only read forwards: for an earlier step it is opened again.
    fn read(&mut self, step: usize) -> Result<Delivered> {
        if let Some(source) = self.feed.source() {
            let is_past = self.kept.front().is_some_and(|&(newest, _)| step < newest);
            return Ok(if is_past { Delivered::Missing } else { source.newest(MAX_AGE) });
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
