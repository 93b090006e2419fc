//! The frames of one camera, a folder of photos, a video file or a source, read one frame at a time; the first frames of all cameras.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, anyhow, bail};
use liveview::ImageRgb;
use liveview::geometry::Size;
use liveview::image;
use liveview_scene::{Format, Found, ListedPhoto, Photo, PhotoList, PhotoSource, SceneError};

use super::source::{Origin, Source, SourceClock};
use super::steps::{Photos, photos_in};
use crate::ffmpeg::{Decoder, FrameRate, count_frames};
use liveview_files::has_extension;

const VIDEOS: [&str; 7] = ["mp4", "m4v", "mov", "mkv", "avi", "webm", "y4m"];

/// A camera of a rig, and where its frames are read from.
#[derive(Debug, Clone)]
pub struct Feed {
    /// The name of its folder, or of its video without the extension.
    pub name: String,
    frames: Frames,
}

#[derive(Debug, Clone)]
enum Frames {
    Photos(Photos),
    /// All frames, or with a rate the frame at each of its times.
    Video(PathBuf, Option<FrameRate>),
    Source(Arc<Source>),
}

impl Feed {
    /// The cameras of a rig: folders of photos and video files in a folder, in byte order of their names.
    pub(super) fn all_in(folder: &Path) -> Result<Vec<Self>> {
        let mut feeds = Vec::new();
        for entry in std::fs::read_dir(folder).with_context(|| folder.display().to_string())? {
            let path = entry?.path();
            let Some(name) = path.file_stem().and_then(|name| name.to_str()).map(str::to_owned) else { continue };
            if name.starts_with('.') {
                continue;
            }
            if path.is_file() && has_extension(&path, &VIDEOS) {
                feeds.push(Self { name, frames: Frames::Video(path, None) });
            } else if path.is_dir() {
                let photos = photos_in(&path)?;
                let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                if !photos.is_empty() {
                    feeds.push(Self { name, frames: Frames::Photos(photos) });
                }
            }
        }
        feeds.sort_by(|a, b| a.name.cmp(&b.name));
        if let Some(pair) = feeds.windows(2).find(|pair| pair[0].name == pair[1].name) {
            bail!("{}: two cameras are named {}; expected a name for each", folder.display(), pair[0].name);
        }
        Ok(feeds)
    }

    /// A camera that ffmpeg opens; its frames are read one after the other, or as they come.
    pub(super) fn open_source(name: String, url: PathBuf, clock: SourceClock, origin: &Arc<Origin>) -> Self {
        let origin = (clock == SourceClock::Stream).then(|| Arc::clone(origin));
        let is_read = clock == SourceClock::Frame;
        let frames = if is_read { Frames::Video(url, None) } else { Frames::Source(Source::start(&url, origin)) };
        Self { name, frames }
    }

    /// The camera, if it runs.
    pub fn source(&self) -> Option<&Arc<Source>> {
        if let Frames::Source(source) = &self.frames { Some(source) } else { None }
    }

    /// The number of time steps, one more than the last; `None` for a video, which would have to be read.
    pub fn steps(&self) -> Option<usize> {
        match &self.frames {
            Frames::Photos(photos) => photos.last_key_value().map(|(last, _)| last + 1),
            Frames::Video(..) | Frames::Source(_) => None,
        }
    }

    /// The number of time steps, without end for a source; ffmpeg counts those of a video, without decoding.
    ///
    /// # Errors
    /// ffmpeg cannot read the video.
    pub(super) fn count_steps(&self) -> Result<usize> {
        match &self.frames {
            Frames::Photos(_) => Ok(self.steps().unwrap_or(0)),
            Frames::Source(_) => Ok(usize::MAX),
            Frames::Video(path, None) => count_frames(path),
            Frames::Video(path, Some(steps)) => {
                let seconds = count_frames(path)? as f64 / Decoder::rate(path)?.per_second();
                Ok((seconds * steps.per_second()).round().max(1.0) as usize)
            }
        }
    }

    /// Whether it is a video file.
    pub fn is_video(&self) -> bool {
        matches!(self.frames, Frames::Video(..))
    }

    /// Its name and its photos, if it is a folder of photos.
    pub fn photos_mut(&mut self) -> Option<(&str, &mut Photos)> {
        match &mut self.frames {
            Frames::Photos(photos) => Some((&self.name, photos)),
            Frames::Video(..) | Frames::Source(_) => None,
        }
    }

    /// The frame rate of a video.
    pub fn rate(&self) -> Result<Option<FrameRate>> {
        match &self.frames {
            Frames::Photos(_) | Frames::Source(_) => Ok(None),
            Frames::Video(path, _) => Decoder::rate(path).map(Some),
        }
    }

    /// Makes a video deliver the frame at each time of a rate.
    pub(super) fn set_rate(&mut self, steps: FrameRate) {
        if let Frames::Video(_, rate) = &mut self.frames {
            *rate = Some(steps);
        }
    }

    /// The file of its first readable frame, and the size in pixels.
    ///
    /// # Errors
    /// No frame can be read; the error of the first.
    pub(super) fn first_frame(&self) -> Result<(PathBuf, Size)> {
        match &self.frames {
            Frames::Photos(photos) => {
                let mut failed = None;
                for path in photos.values() {
                    match image::read_size(path) {
                        Ok(size) => return Ok((path.clone(), size)),
                        Err(error) => failed = failed.or(Some(error)),
                    }
                }
                Err(failed.map_or_else(|| anyhow!("{}: no frames", self.name), Into::into))
            }
            Frames::Video(path, _) => Ok((path.clone(), first_of_video(path)?.size())),
            Frames::Source(source) => Ok((source.url().to_owned(), source.first()?.size())),
        }
    }

    /// A reader of its frames, from the first on.
    pub fn open(&self) -> Result<Reader> {
        Ok(match &self.frames {
            Frames::Photos(photos) => Reader(OpenFrames::Photos(photos.clone())),
            Frames::Video(path, rate) => Reader(OpenFrames::Video(Decoder::start(path, *rate)?)),
            Frames::Source(_) => Reader(OpenFrames::Running),
        })
    }
}

fn unread(path: &Path, error: &anyhow::Error) -> SceneError {
    SceneError::Read { path: path.to_owned(), source: io::Error::other(format!("{error:#}")) }
}

fn first_of_video(path: &Path) -> Result<ImageRgb> {
    let first = Decoder::start(path, None)?.next()?;
    first.ok_or_else(|| anyhow!("{}: the video holds no frame", path.display()))
}

/// Reads the frames of a camera in the order of time.
#[derive(Debug)]
pub struct Reader(OpenFrames);

#[derive(Debug)]
enum OpenFrames {
    Photos(Photos),
    Video(Decoder),
    /// Read from [`Feed::source`].
    Running,
}

/// The result of reading a time step of a camera.
#[derive(Debug)]
pub enum Delivered {
    /// Its photo, and when it arrived.
    Photo(ImageRgb, Instant),
    /// There is no frame for this step, but later ones.
    Missing,
    /// There are no more frames.
    Ended,
}

impl Reader {
    /// Reads the frame of a time step; a video must be read in order.
    ///
    /// # Errors
    /// The photo is damaged, or the decoder failed.
    pub fn read(&mut self, step: usize) -> Result<Delivered> {
        match &mut self.0 {
            OpenFrames::Photos(photos) => match photos.get(&step) {
                Some(path) => Ok(Delivered::Photo(image::load(path)?, Instant::now())),
                None if photos.range(step..).next().is_some() => Ok(Delivered::Missing),
                None => Ok(Delivered::Ended),
            },
            OpenFrames::Video(decoder) => {
                Ok(decoder.next()?.map_or(Delivered::Ended, |photo| Delivered::Photo(photo, Instant::now())))
            }
            OpenFrames::Running => Ok(Delivered::Missing),
        }
    }

    /// Skips the frame of a time step; false if there are no more.
    pub fn skip(&mut self, step: usize) -> Result<bool> {
        match &mut self.0 {
            OpenFrames::Photos(photos) => Ok(photos.range(step..).next().is_some()),
            OpenFrames::Video(decoder) => decoder.skip(),
            OpenFrames::Running => Ok(true),
        }
    }
}

/// A camera with at least one readable frame.
#[derive(Debug)]
pub(super) struct RigCamera {
    pub(super) feed: Feed,
    /// The file of its first readable frame.
    pub(super) first: PathBuf,
    /// In pixels.
    pub(super) size: Size,
}

impl RigCamera {
    fn photo(&self) -> Photo {
        Photo { name: self.feed.name.clone(), path: self.first.clone(), size: self.size, ignored: Vec::new() }
    }
}

/// The first frame of each camera. Pose files may name it by the camera, by any of its frames, or by its video.
#[derive(Debug)]
pub(super) struct RigPhotos {
    /// In byte order of their names.
    pub(super) cameras: Vec<RigCamera>,
}

impl RigPhotos {
    pub(super) fn named(&self, name: &str) -> Option<&RigCamera> {
        self.cameras.iter().find(|camera| camera.feed.name == name)
    }

    /// The camera that a path belongs to: `cam00` for `cam00`, `cam00.mp4`, `images/cam00.png` and `cam00/0000.jpg`. The last part of
    /// the path that names a camera counts.
    fn of_frame(&self, name: &str) -> Option<&RigCamera> {
        // `cam.0` may be a camera beside `cam`.
        let of_part = |part: &str| self.named(part).or_else(|| self.named(part.rsplit_once('.')?.0));
        name.rsplit('/').find_map(of_part)
    }
}

impl PhotoSource for RigPhotos {
    /// All formats but RealEstate10K, whose poses are those of a single moving camera.
    fn supports(&self, format: Format) -> bool {
        format != Format::RealEstate10k
    }

    fn find(&self, listed: &ListedPhoto<'_>) -> Result<Found, SceneError> {
        Ok(match self.of_frame(listed.name) {
            Some(camera) => Found::Shared(camera.photo()),
            None => Found::Skipped(format!("{} belongs to no camera: skipped", listed.name)),
        })
    }

    fn list(&self, _: &[&str]) -> Result<Option<PhotoList>, SceneError> {
        let names = self.cameras.iter().map(|camera| camera.feed.name.clone()).collect();
        Ok(Some(PhotoList { folder: None, names }))
    }

    fn load(&self, name: &str) -> Result<ImageRgb, SceneError> {
        let Some(RigCamera { feed, first, .. }) = self.named(name) else {
            return Err(SceneError::Read { path: name.into(), source: io::ErrorKind::NotFound.into() });
        };
        match &feed.frames {
            Frames::Photos(_) => Ok(image::load(first)?),
            Frames::Video(path, _) => first_of_video(path).map_err(|error| unread(first, &error)),
            Frames::Source(source) => source.first().map_err(|error| unread(first, &error)),
        }
    }
}
