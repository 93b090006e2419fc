//! What one camera delivers: a folder of photos or a video file, read one frame at a time.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use liveview::geometry::Size;
use liveview::image::{self, ImageRgb};

use crate::args::output::has_ending;
use crate::ffmpeg::Decoder;

const PHOTOS: [&str; 3] = ["png", "jpg", "jpeg"];
const VIDEOS: [&str; 7] = ["mp4", "m4v", "mov", "mkv", "avi", "webm", "y4m"];

/// A camera's frames, unread.
#[derive(Debug, Clone)]
pub(super) struct Feed {
    /// Of its folder, or of its file without the ending.
    pub(super) name: String,
    frames: Frames,
}

#[derive(Debug, Clone)]
enum Frames {
    /// By time step.
    Photos(BTreeMap<usize, PathBuf>),
    Video(PathBuf),
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
            if path.is_file() && has_ending(&path, &VIDEOS) {
                feeds.push(Self { name, frames: Frames::Video(path) });
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

    /// Time steps, where they can be told without reading: one more than the last.
    pub(super) fn steps(&self) -> Option<usize> {
        match &self.frames {
            Frames::Photos(photos) => photos.last_key_value().map(|(last, _)| last + 1),
            Frames::Video(_) => None,
        }
    }

    /// Time step of the first frame.
    pub(super) fn first(&self) -> usize {
        match &self.frames {
            Frames::Photos(photos) => photos.first_key_value().map_or(0, |(first, _)| *first),
            Frames::Video(_) => 0,
        }
    }

    /// Steps counted from `first` instead.
    pub(super) fn counted_from(&mut self, first: usize) {
        if let Frames::Photos(photos) = &mut self.frames {
            *photos =
                std::mem::take(photos).into_iter().map(|(step, path)| (step.saturating_sub(first), path)).collect();
        }
    }

    /// Its first frame that can be read.
    ///
    /// # Errors
    /// None can; what is wrong with the first.
    pub(super) fn first_frame(&self) -> Result<FirstFrame> {
        match &self.frames {
            Frames::Photos(photos) => {
                let mut failed = None;
                for path in photos.values() {
                    match image::read_size(path) {
                        Ok(size) => return Ok(FirstFrame { path: path.clone(), size }),
                        Err(error) => failed = failed.or(Some(error)),
                    }
                }
                Err(failed.map_or_else(|| anyhow!("{}: no frames", self.name), Into::into))
            }
            Frames::Video(path) => {
                let photo = first_of_video(path)?;
                Ok(FirstFrame { path: path.clone(), size: photo.size() })
            }
        }
    }

    /// The pixels of that frame.
    ///
    /// # Errors
    /// It is damaged, or gone.
    pub(super) fn load_first(&self, first: &FirstFrame) -> Result<ImageRgb> {
        match &self.frames {
            Frames::Photos(_) => Ok(image::load(&first.path)?),
            Frames::Video(path) => first_of_video(path),
        }
    }

    /// Its frames, from the first on.
    pub(super) fn open(&self) -> Result<Reader> {
        Ok(match &self.frames {
            Frames::Photos(photos) => Reader::Photos(photos.clone()),
            Frames::Video(path) => Reader::Video(Decoder::start(path)?),
        })
    }
}

/// The first frame of a camera that can be read.
#[derive(Debug, Clone)]
pub(super) struct FirstFrame {
    /// Its file, or that of the video.
    pub(super) path: PathBuf,
    /// In pixels.
    pub(super) size: Size,
}

fn first_of_video(path: &Path) -> Result<ImageRgb> {
    let first = Decoder::start(path)?.next()?;
    first.ok_or_else(|| anyhow!("{}: the video holds no frame", path.display()))
}

/// Frames of a camera in the order of time.
pub(super) enum Reader {
    Photos(BTreeMap<usize, PathBuf>),
    Video(Decoder),
}

/// What a camera has at a time step.
pub(super) enum Delivered {
    Photo(ImageRgb),
    /// No file for this step, though there are later ones.
    Missing,
    /// Nothing more.
    Ended,
}

impl Reader {
    /// The frame of a time step; a video is read in order.
    ///
    /// # Errors
    /// A photo that is damaged; a decoder that failed.
    pub(super) fn read(&mut self, step: usize) -> Result<Delivered> {
        match self {
            Self::Photos(photos) => match photos.get(&step) {
                Some(path) => Ok(Delivered::Photo(image::load(path)?)),
                None if photos.range(step..).next().is_some() => Ok(Delivered::Missing),
                None => Ok(Delivered::Ended),
            },
            Self::Video(decoder) => Ok(decoder.next()?.map_or(Delivered::Ended, Delivered::Photo)),
        }
    }

    /// Passes over the frame of a time step; whether there may be more.
    pub(super) fn skip(&mut self, step: usize) -> Result<bool> {
        match self {
            Self::Photos(photos) => Ok(photos.range(step..).next().is_some()),
            Self::Video(decoder) => decoder.skip(),
        }
    }
}

/// The photos of a folder by time step: the last number in their names where all have one, their order otherwise.
fn photos_in(folder: &Path) -> Result<BTreeMap<usize, PathBuf>> {
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    paths.retain(|path| {
        let hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        !hidden && has_ending(path, &PHOTOS) && !path.is_dir()
    });
    paths.sort();
    let numbered: Option<BTreeMap<usize, PathBuf>> =
        paths.iter().map(|path| Some((last_number(path)?, path.clone()))).collect();
    Ok(match numbered.filter(|numbered| numbered.len() == paths.len()) {
        Some(numbered) => numbered,
        None => paths.into_iter().enumerate().collect(),
    })
}

fn last_number(path: &Path) -> Option<usize> {
    let stem = path.file_stem()?.to_str()?;
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end]
        .rfind(|c: char| !c.is_ascii_digit())
        .map_or(0, |at| at + stem[at..].chars().next().map_or(1, char::len_utf8));
    stem[start..end].parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_matched_by_number_or_by_order() {
        let folder = tempfile::tempdir().unwrap();
        let add = |name: &str| std::fs::write(folder.path().join(name), "").unwrap();
        ["f2_10.jpg", "f2_9.jpg", "f2_12.PNG", "notes.txt", ".f2_1.jpg"].into_iter().for_each(add);
        let names = |photos: BTreeMap<usize, PathBuf>| -> Vec<(usize, String)> {
            photos.into_iter().map(|(step, path)| (step, path.file_name().unwrap().to_str().unwrap().into())).collect()
        };
        let expected = [(9, "f2_9.jpg"), (10, "f2_10.jpg"), (12, "f2_12.PNG")].map(|(k, n)| (k, n.to_owned()));
        assert_eq!(names(photos_in(folder.path()).unwrap()), expected);
        add("last.png");
        let by_order = names(photos_in(folder.path()).unwrap());
        assert_eq!((by_order.len(), by_order[3].clone()), (4, (3, "last.png".to_owned())));
    }
}
