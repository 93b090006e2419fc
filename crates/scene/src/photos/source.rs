//! The source of a scene's photos: which photos exist, their sizes, their pixels.
//!
//! A scene's poses are read from files; its photos need not be. [`Scene::open`](crate::Scene::open)
//! uses [`PhotoFolder`](crate::PhotoFolder). For photos from elsewhere (the frames of a camera rig,
//! an archive, memory), pass your own source to [`Scene::open_with`](crate::Scene::open_with).

use std::fmt::Debug;
use std::path::{Path, PathBuf};

use crate::{Format, SceneError};
use liveview::geometry::Size;
use liveview::image::ImageRgb;

/// A photo that exists.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Photo {
    /// Its name in the source, unique there, with `/` between folders. Views are named after it.
    pub name: String,
    /// The file it comes from, for messages and to protect it from being overwritten by outputs.
    pub path: PathBuf,
    /// Size in pixels.
    pub size: Size,
    /// Properties of the file that are ignored, such as its alpha channel, as text for the scene's
    /// notes.
    pub ignored: Vec<&'static str>,
}

/// A photo as a pose file lists it.
#[derive(Debug, Clone, Copy)]
pub struct ListedPhoto<'a> {
    /// The name as the pose file writes it, with `/` between folders, or the folder and name from
    /// [`PhotoSource::list`].
    pub name: &'a str,
    /// The pose file, for messages.
    pub listed_in: &'a Path,
}

/// The result of looking up a listed photo.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Found {
    /// The photo, which no other entry lists.
    Photo(Photo),
    /// A photo that several entries may list, such as a camera's current frame listed by all names
    /// of its frames. The first such entry becomes a view; the others are skipped without a note.
    Shared(Photo),
    /// The entry is skipped; the text becomes one of the scene's notes.
    Skipped(String),
}

/// Photos of formats that match them by order or by file name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PhotoList {
    /// The folder that holds them; `None` if the source has no folders.
    pub folder: Option<String>,
    /// Their names inside that folder, in byte order.
    pub names: Vec<String>,
}

impl PhotoList {
    /// The name, preceded by the folder.
    pub(crate) fn with_folder(&self, name: &str) -> String {
        self.folder.as_ref().map_or_else(|| name.to_owned(), |folder| format!("{folder}/{name}"))
    }
}

/// Photos by name.
pub trait PhotoSource: Debug + Send + Sync {
    /// Whether a scene of this format can use these photos; otherwise its files are not read.
    fn supports(&self, format: Format) -> bool {
        let _ = format;
        true
    }

    /// Looks up the photo of an entry, without reading its pixels.
    ///
    /// # Errors
    ///
    /// [`SceneError::MissingImage`] if the photo does not exist: its entry is skipped with a note,
    /// and the scene is refused if no other photo exists either. Any other error refuses the scene:
    /// [`SceneError::Malformed`] for a name that points outside the source; [`SceneError::Image`] if
    /// the photo's size cannot be read.
    fn find(&self, listed: &ListedPhoto<'_>) -> Result<Found, SceneError>;

    /// All photos of the first of these folders that exists; `None` if none exists. A source
    /// without folders lists all its photos.
    ///
    /// # Errors
    ///
    /// [`SceneError::Read`] if a folder cannot be read.
    fn list(&self, folders: &[&str]) -> Result<Option<PhotoList>, SceneError>;

    /// Decodes a photo, given the [`Photo::name`] that [`PhotoSource::find`] returned.
    ///
    /// # Errors
    ///
    /// [`SceneError::Image`] if it is damaged, [`SceneError::Read`] if it cannot be read.
    fn load(&self, name: &str) -> Result<ImageRgb, SceneError>;
}
