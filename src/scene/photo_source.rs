//! Where the photos of a scene come from: which exist, their sizes, their pixels.
//!
//! A scene's poses are read from files; its photos need not be. [`PhotoFolder`](super::PhotoFolder) is the source that
//! [`Scene::open`](super::Scene::open) takes; whoever has photos elsewhere (the frames of a camera rig, an archive, memory) hands
//! a source of their own to [`Scene::open_with`](super::Scene::open_with).

use std::fmt::Debug;
use std::path::{Path, PathBuf};

use super::error::SceneError;
use super::format::Format;
use crate::geometry::Size;
use crate::image::ImageRgb;

/// A photo that exists.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Photo {
    /// What its source calls it, with `/` between folders; no two photos of a source share a name. Views are named after it.
    pub name: String,
    /// The file it comes from, for messages and so that no output overwrites it.
    pub path: PathBuf,
    /// In pixels.
    pub size: Size,
    /// What of the file is not used, such as its alpha channel, in words; the scene's notes say so.
    pub ignored: Vec<&'static str>,
}

/// A photo as a pose file lists it.
#[derive(Debug, Clone, Copy)]
pub struct ListedPhoto<'a> {
    /// The name as written there, or as [`PhotoSource::list`] gave it, with its folder.
    pub name: &'a str,
    /// The pose file, for messages.
    pub listed_in: &'a Path,
    /// Whether the same name with another image extension, or with one added, will do as well.
    pub any_extension: bool,
}

/// What a source has for a name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Found {
    /// The photo of this name and of no other.
    Photo(Photo),
    /// A photo that has many names, as that of a camera whose frames all have one. The first entry that names it becomes a
    /// view; the others are left out without a word.
    OneOfMany(Photo),
    /// The entry is to be left out; the scene's notes say so in these words.
    LeftOut(String),
}

/// Photos that a pose file takes by order or by file name alone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PhotoList {
    /// The folder that they are in; `None` where the source keeps them in no folder.
    pub folder: Option<String>,
    /// Their names inside that folder, in byte order.
    pub names: Vec<String>,
}

impl PhotoList {
    /// The name with the folder before it.
    pub(super) fn with_folder(&self, name: &str) -> String {
        self.folder.as_ref().map_or_else(|| name.to_owned(), |folder| format!("{folder}/{name}"))
    }
}

/// Photos by name.
pub trait PhotoSource: Debug + Send + Sync {
    /// Whether a scene of this format can be made of these photos; if not, its files are passed over.
    fn serves(&self, format: Format) -> bool {
        let _ = format;
        true
    }

    /// The photo of an entry, without reading its pixels.
    ///
    /// # Errors
    ///
    /// [`SceneError::MissingImage`] where the entry names a photo that should exist and does not; [`SceneError::UnsafePath`] for
    /// a name that leads elsewhere; [`SceneError::Image`] for a photo whose size cannot be read. The scene is then refused: an
    /// entry that may be absent is [`Found::LeftOut`].
    fn find(&self, listed: &ListedPhoto<'_>) -> Result<Found, SceneError>;

    /// All photos of the first of these folders that the source has; `None` if it has none of them. A source without folders
    /// lists all its photos.
    ///
    /// # Errors
    ///
    /// [`SceneError::Read`] for a folder that cannot be read.
    fn list(&self, folders: &[&str]) -> Result<Option<PhotoList>, SceneError>;

    /// The pixels of a photo, by the name that [`PhotoSource::find`] gave it.
    ///
    /// # Errors
    ///
    /// [`SceneError::Image`] or [`SceneError::Read`] if it is damaged or gone.
    fn load(&self, name: &str) -> Result<ImageRgb, SceneError>;
}
