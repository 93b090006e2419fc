//! The first frames of a rig's cameras, as the photos of a scene.

use std::io;

use liveview::ImageRgb;
use liveview::image::ImageError;
use liveview::scene::{Format, Found, ListedPhoto, Photo, PhotoList, PhotoSource, SceneError};

use super::feed::{Feed, FirstFrame};

/// A camera with at least one readable frame.
#[derive(Debug)]
pub(super) struct RigCamera {
    pub(super) feed: Feed,
    pub(super) first: FirstFrame,
}

impl RigCamera {
    fn photo(&self) -> Photo {
        let FirstFrame { path, size } = &self.first;
        Photo { name: self.feed.name.clone(), path: path.clone(), size: *size, ignored: Vec::new() }
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
        let Some(RigCamera { feed, first }) = self.named(name) else {
            return Err(SceneError::Read { path: name.into(), source: io::ErrorKind::NotFound.into() });
        };
        feed.load_first(first).map_err(|error| match error.downcast::<ImageError>() {
            Ok(error) => error.into(),
            Err(error) => SceneError::Read { path: first.path.clone(), source: io::Error::other(format!("{error:#}")) },
        })
    }
}
