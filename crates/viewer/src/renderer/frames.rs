//! The frames of a rig's cameras at any time step.

use std::collections::VecDeque;
use std::sync::Arc;

use anyhow::{Result, anyhow, bail};
use liveview::live::LiveError;
use liveview::{ImageRgb, Scene};
use liveview_common::interrupt;
use liveview_live::rig::{Delivered, Feed, Reader};
use rayon::prelude::*;

/// Frames stay in memory as far as this goes, the last of each camera in any case …
const KEPT_BYTES: usize = 128 << 20;
/// … at so many bytes a pixel.
const BYTES_PER_PIXEL: usize = 12;

/// The frames of all cameras; the last ones stay in memory.
pub(super) struct Frames {
    scene: Scene,
    cameras: Vec<CameraFrames>,
}

/// The photos of one time step.
pub(super) struct Step {
    /// By camera; `None` where it has none, or was not asked.
    photos: Vec<Option<Arc<ImageRgb>>>,
    /// Cameras that were asked and have none, and why.
    pub(super) left_out: Vec<String>,
}

impl Step {
    pub(super) fn photos(&self) -> Vec<Option<&ImageRgb>> {
        self.photos.iter().map(Option::as_deref).collect()
    }

    /// An error, with the cameras that may be to blame for it.
    pub(super) fn blamed(&self, error: LiveError) -> anyhow::Error {
        match (&error, &self.left_out[..]) {
            (LiveError::Views(_), [_, ..]) => anyhow!("{error}; {}", self.left_out.join("; ")),
            _ => error.into(),
        }
    }
}

impl Frames {
    pub(super) fn new(scene: Scene, feeds: &[Feed]) -> Self {
        let pixels: usize = scene.views.iter().map(|view| view.camera.size().pixels()).sum();
        let room = (KEPT_BYTES / (BYTES_PER_PIXEL * pixels.max(1))).max(1);
        let camera = |feed: &Feed| CameraFrames { feed: feed.clone(), reader: None, kept: VecDeque::new(), room };
        Self { scene, cameras: feeds.iter().map(camera).collect() }
    }

    /// What these cameras have at a time step.
    pub(super) fn at(&mut self, step: usize, cameras: &[usize]) -> Step {
        let Self { scene, cameras: all } = self;
        let read = |(index, camera): (usize, &mut CameraFrames)| {
            cameras.contains(&index).then(|| camera.at(step, |photo| Ok(scene.fit(index, photo)?)))
        };
        let read: Vec<_> = all.par_iter_mut().enumerate().map(read).collect();
        let names = scene.views.iter().map(|view| &view.name);
        let left_out = names.zip(&read).filter_map(|(name, read)| Some((name, read.as_ref()?.as_ref().err()?)));
        let left_out = left_out.map(|(name, why)| format!("{name}: {why}")).collect();
        Step { photos: read.into_iter().map(|read| read?.ok()).collect(), left_out }
    }

    /// What a camera has at a time step.
    ///
    /// # Errors
    /// Nothing, and why.
    pub(super) fn photo(&mut self, camera: usize, step: usize) -> Result<ImageRgb> {
        let mut read = self.at(step, &[camera]);
        let photo = read.photos.swap_remove(camera);
        photo.map(|photo| (*photo).clone()).ok_or_else(|| anyhow!("{}", read.left_out.join("; ")))
    }
}

/// The frames of a camera.
struct CameraFrames {
    feed: Feed,
    /// Its frames from a time step on.
    reader: Option<(Reader, usize)>,
    /// The last that were read, or why they were not, by time step.
    kept: VecDeque<(usize, Result<Arc<ImageRgb>, String>)>,
    room: usize,
}

impl CameraFrames {
    fn at(&mut self, step: usize, fit: impl FnOnce(ImageRgb) -> Result<ImageRgb>) -> Result<Arc<ImageRgb>, String> {
        if let Some((_, kept)) = self.kept.iter().find(|(kept, _)| *kept == step) {
            return kept.clone();
        }
        let photo = match self.read(step) {
            Ok(Delivered::Photo(photo)) => fit(photo).map(Arc::new),
            Ok(Delivered::Missing) => Err(anyhow!("frame {step} is missing")),
            Ok(Delivered::Ended) => Err(anyhow!("no frames from {step} on")),
            Err(error) => {
                self.reader = None;
                Err(error)
            }
        };
        let photo = photo.map_err(|error| format!("{error:#}"));
        // What could not be read is tried again when it is asked for again.
        if self.reader.is_some() {
            self.kept.truncate(self.room - 1);
            self.kept.push_front((step, photo.clone()));
        }
        photo
    }

    /// A video is read forwards alone: what lies behind is read from its beginning.
    fn read(&mut self, step: usize) -> Result<Delivered> {
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
